"""Why no cloud comes out: what was seen of a running graph, judged along the chain. Pure; `ros.observer.probe` sees."""

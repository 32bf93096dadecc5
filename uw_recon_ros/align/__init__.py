"""All frames laid together: loops, pose graph, and what the dive says about its own rig."""

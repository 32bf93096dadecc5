"""From frame to frame: key points, the relation of two frames, and the bridge where features are lost."""

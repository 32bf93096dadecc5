"""Where on Earth a model lies: coordinate systems, their origin, and maps that other programs can place."""

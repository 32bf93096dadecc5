"""Self-contained HTML pages: pictures, numbers, and a 3-D view that works without a network."""

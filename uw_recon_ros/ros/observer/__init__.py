"""Looking at a running graph from outside, for `doctor`: apart from what makes a node."""

"""What tests of several rooms share: makers of bags, scenes and messages, benches for nodes and processes."""

"""The executables' nodes: topics, and one line of stage."""

"""Where the vehicle was: the whole way of a dive from its frames."""

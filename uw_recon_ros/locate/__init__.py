"""The trajectory: where the vehicle was, estimated from all frames of a dive."""

"""One model of a dive out of a finished survey: where the vehicle was, one surface, a map. Files and arguments only."""

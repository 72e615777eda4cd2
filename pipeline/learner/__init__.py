"""Learning rules, how they are found, and the controller file; knows no log, robot or network."""

"""The learning rule and its file: network, kernels, configuration, controller; knows no log, robot or network."""

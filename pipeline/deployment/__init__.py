"""A served controller and a simulated robot in processes of their own, measured."""

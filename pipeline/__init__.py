"""Robot, teacher, simulation, learner and evaluation, and the commands that wire them."""

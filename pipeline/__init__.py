"""Robot, teacher, simulation, learner and evaluation, and the commands that wire them."""

import logging

logging.getLogger(__name__).addHandler(logging.NullHandler())

"""What runs behind the page: robot, controllers, recorder and the targets of the hands; it knows no viser."""

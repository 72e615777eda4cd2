"""Keys of topics, and who publishes and subscribes there: the graph of a ROS domain."""

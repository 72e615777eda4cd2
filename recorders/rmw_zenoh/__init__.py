"""Names, keys, attachments and liveliness tokens of rmw_zenoh, ROS 2's Zenoh middleware, as plain text and bytes."""

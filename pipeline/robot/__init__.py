"""The robot as data: configuration, import of models, kinematics, range check, the backend protocol."""

"""A page in the browser that shows a robot, leads its hands, records and teaches; only the verb `play` imports it."""

"""Learning rules that come with the program: one module or package each, named as the rule is, with its `RULE`."""

"""Verbs that learn from logs and check what was learned; they open no session of their own."""

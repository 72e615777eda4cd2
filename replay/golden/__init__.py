"""Golden cases: their format, their tiers and their comparison; knows no learner."""

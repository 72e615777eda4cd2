"""Pictures and Rerun views of motions and learning."""

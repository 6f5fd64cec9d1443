"""tiller distill: a planner's answers in a small network (docs/theory/distill.md)."""

"""The methods of the literature behind `tiller identify --method` (docs/theory/methods.md)."""

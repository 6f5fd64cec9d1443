"""Many robots of one kind: `tiller fleet` fits each by itself and then looks at all of them together."""

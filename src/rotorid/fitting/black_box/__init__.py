"""Models without a given structure: subspaces, polynomials, black boxes."""

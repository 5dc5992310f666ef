"""From an identified plant to gains: what flew, what to change and what that will do, and whether it did."""

"""Choice among the leaves of hypothesis trees: what the global hypotheses are computed with."""

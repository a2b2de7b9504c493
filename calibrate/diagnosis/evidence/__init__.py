"""Bayesian evidence for subsets of effects: priors, all explanations ranked, power."""

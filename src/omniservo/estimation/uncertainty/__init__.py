"""Covariance of estimates: first order, the likelihood's own region, samples, shared errors."""

"""What is kept of rows, estimators, and covariance under autocorrelated noise."""

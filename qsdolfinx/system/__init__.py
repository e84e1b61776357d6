"""Bodies and contacts as one system of equations: residual and tangent."""

"""`fit_orthogonal`: a surface through points in space, by their distances along its normals."""

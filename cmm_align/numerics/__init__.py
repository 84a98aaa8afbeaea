"""Arrays in, arrays out: the mathematics, free of files, frames and settings.

- Surfaces: `tensor_spline`, `scattered_spline`, `knot_basis`, `foot_point`, `triangle_net`, `ball_envelope`.
- The rigid fit: `linearisation`, `steering` (weights, locks, datum terms), `rigid_fit`, `observability`,
  `outliers`, `rotations`, `moments`, `free_offset`, `free_scale`, `helpful_points`; from any start: `pose_*`;
  to the minimum zone: `minimum_zone`, `zone_*`; of the literature: `icp_*`, `reference_*`; errors of a
  machine: `machine_error`.
- Maps: `local_regression`, `grid_field`, `aperture_basis`, `point_density`, `correlated_fit`; waves:
  `areal_filter` (Gaussian regression, bands), `local_gaussian`, `areal_spline_filter`, `spectral_density`.
- Clouds without a nominal: `local_normals`.
"""

"""The stages, each pure and each written like the method section of a paper.

The four of the chain: `offset`, `align`, `error_map`, `compensate`. Beside them `plan` (a measuring plan),
`estimated_contacts` (parts without a design) and `reference_methods` (of the literature, to compare with).
The rest are parts of one stage: `align` checks `plausibility`, turns choices into `constraints`, finds its
`way`, makes its `best_fit` of the points of its `selection`, asks the `fit_doctor` (`mistakes`, `findings`,
`fit_failure`) and its `fit_checks`, takes a `second_path`, and tells in its `alignment_report` what it knows:
`pose_uncertainty`, `pose_knowledge`, `removed_motion`, on request `monte_carlo` and `bidirectional`.
`error_map` takes its `low_orders`, its `map_filter` and its `root_causes` (by `cause_signatures`, beyond the
`told_motions`); it and `compensate` count with
`deviation_statistics`.
"""

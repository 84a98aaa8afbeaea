"""The stages, each pure and each written like the method section of a paper.

The four of the chain: `offset`, `align`, `error_map`, `compensate`. Beside them `plan` (a measuring plan) and
`estimated_contacts` (parts without a design). The rest are parts of one stage: `align` checks `plausibility`,
finds its `way`, asks the `fit_doctor` (`mistakes`, `findings`, `fit_failure`), takes a `second_path` and
states its `pose_uncertainty`; `error_map` and `compensate` count with `deviation_statistics`.
"""

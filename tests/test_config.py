from dataclasses import fields

import pytest

from cmm_align.config import ALIGN_CHOICES, FILTERS, AlignConfig, Config, read_config
from cmm_align.errors import MissingFileError, UsageError
from cmm_align.limits import LIMITS


def written(tmp_path, text):
    path = tmp_path / "job.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_later_files_win_and_the_rest_is_default(tmp_path):
    first = written(tmp_path, "[align]\ncoarse_points = 5000\nmax_iterations = 10\n")
    second = tmp_path / "second.toml"
    second.write_text("[align]\nmax_iterations = 20\n", encoding="utf-8")

    config = read_config([first, second])

    assert (config.align.coarse_points, config.align.max_iterations) == (5000, 20)
    assert config.compensate == Config().compensate


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[align]\ncoarse_point = 5\n", "did you mean 'coarse_points'"),
        ("[alain]\n", "did you mean 'align'"),
        ("[align]\ncoarse_points = 0\n", "expected 100 to 1e+08"),
        ("[align]\nstep_tolerance = 0.1\n", "step_tolerance = 0.1"),
        ("[error_map]\nguard_factor = -3\n", "expected 0 to 10"),
        ("[compensate]\ngain = true\n", "gain = True"),
        ("[compensate]\ngain = nan\n", "gain = nan"),
        ("[offset]\nside = 3\n", "a value like '+z'"),
        ("[align\n", "not valid TOML"),
    ],
)
def test_a_mistake_is_named_with_its_file(tmp_path, text, words):
    with pytest.raises(UsageError, match="job") as caught:
        read_config([written(tmp_path, text)])

    assert words in str(caught.value)


def test_a_missing_file_is_an_input_error(tmp_path):
    with pytest.raises(MissingFileError):
        read_config([tmp_path / "none.toml"])


def test_every_number_has_limits_and_every_default_lies_within():
    for section in fields(Config):
        settings = getattr(Config(), section.name)
        for field in fields(settings):
            value = getattr(settings, field.name)
            if isinstance(value, int | float) and not isinstance(value, bool):
                low, high = LIMITS[field.name]
                assert low <= value <= high, field.name


def test_every_name_that_a_setting_may_have_is_known_to_its_stage():
    from cmm_align.stages.map_filter import KINDS
    from cmm_align.stages.reference_methods import METHODS

    assert set(KINDS) == set(FILTERS)
    assert ("foot-point", *METHODS) == ALIGN_CHOICES["method"]
    for name, known in ALIGN_CHOICES.items():
        assert getattr(AlignConfig(), name) in known

"""`error-map --report --card`: the papers beside a map, from a real alignment."""

import shutil

import pytest


@pytest.fixture
def aligned_file(tmp_path, made):
    """A copy of an alignment of the sample window, in a folder of its own, with an awkward name."""
    return shutil.copy(made / "part.align.h5", tmp_path / "T<b>&ä 1.align.h5")


def test_the_papers_lie_beside_the_map(cli, aligned_file):
    ran = cli("error-map", aligned_file, "--report", "--card", "--pass", 2, "--no-picture", "--json")
    names = [path.rpartition("/")[2] for path in ran.json["outputs"]]
    folder = aligned_file.parent
    page = (folder / "T<b>&ä 1.map.html").read_text(encoding="utf-8")

    assert ran.code == 0
    assert names == ["T<b>&ä 1.map.h5", "T<b>&ä 1.map.html", "T<b>&ä 1.card.pdf"]
    assert "<h1>T&lt;b&gt;&amp;ä 1</h1>" in page
    assert "no tolerance given" in page
    assert (folder / "T<b>&ä 1.card.pdf").read_bytes().startswith(b"%PDF-")
    assert not (folder / "T<b>&ä 1.map.png").exists()


@pytest.mark.parametrize(("suffix", "mine"), [(".map.html", "<html>my own</html>"), (".card.pdf", "my own")])
def test_papers_that_are_there_are_kept(cli, aligned_file, suffix, mine):
    there = aligned_file.with_name(aligned_file.name.replace(".align.h5", suffix))
    there.write_text(mine)
    options = ("error-map", aligned_file, "--report", "--card", "--no-picture")

    for more in ((), ("--overwrite",)):  # not even then: it is somebody else's work
        ran = cli(*options, *more)
        assert ran.code == 8
        assert there.read_text() == mine
        assert there.name in ran.err
    assert sorted(path.name for path in aligned_file.parent.iterdir()) == sorted(
        [aligned_file.name, there.name]
    )


def test_papers_of_an_earlier_run_are_replaced_on_request(cli, aligned_file):
    options = ("error-map", aligned_file, "--report", "--card", "--no-picture", "--spacing", "6mm", "-q")

    assert [cli(*options).code, cli(*options).code, cli(*options, "--overwrite").code] == [0, 8, 0]


def test_a_verdict_is_on_the_page_and_its_code_stays(cli, aligned_file):
    ran = cli("error-map", aligned_file, "--report", "--no-picture", "--tolerance-pv", "10um", "-q")
    page = aligned_file.with_name("T<b>&ä 1.map.html").read_text(encoding="utf-8")

    assert ran.code == 5
    assert 'id="verdict">FAIL</p>' in page
    assert "cmm-align compensate &#39;T&lt;b&gt;&amp;ä 1.map.h5&#39;" in page


def test_a_pass_number_needs_a_card(cli, aligned_file):
    ran = cli("error-map", aligned_file, "--pass", 2)

    assert ran.code == 2
    assert "--card" in ran.err

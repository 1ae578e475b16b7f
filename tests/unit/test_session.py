"""A study in Python: names that there are not, and measured files as the user has them."""

import pytest

from regional_lv import session
from regional_lv.errors import InputError
from regional_lv.measured import read_measured


@pytest.fixture
def study(tmp_path):
    return session.Study({"study": "mine"}, tmp_path / "mine")


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda study: study.outputs(C_a_sept=2), "theta: 'C_a_sept' .* did you mean C_a_septal?"),
        (lambda study: study.train("gradientgp"), "'gradientgp' .* did you mean gradient_gp?"),
        (lambda study: study.train("final"), "emulators.names: 'final' is not offered"),
        (lambda study: study.measure("nobody"), "synthetic_subjects: 'nobody' is not offered"),
    ],
)
def test_names_that_there_are_not(study, ask, message):
    with pytest.raises(InputError, match=message):
        ask(study)


def test_a_measured_file_is_imported_before_it_is_used(study, tmp_path, monkeypatch):
    """Its pressures become load fractions; one that was imported stays as it is."""
    used = []
    monkeypatch.setattr(
        session, "criticise_by_emulator", lambda *_, measured, **how: used.extend(measured)
    )
    monkeypatch.setattr(session.posteriors, "load", lambda file: file)
    own = tmp_path / "anna.csv"
    own.write_text("quantity,segment,value,unit,pressure_mmhg\nvolume,,180,mL,8\n")
    emulator = type("Trained", (), {"name": "gradient_gp"})
    study.infer(own, emulator, "anna")
    assert read_measured(used[0])["load_fraction"].tolist() == [1.0]
    study.infer(used[0], emulator, "anna")
    assert used[1] == used[0]
    own.write_text("quantity,segment,value,unit\nradial,1,40,1\n")
    with pytest.raises(InputError, match="write unit %"):
        study.infer(own, emulator, "anna")

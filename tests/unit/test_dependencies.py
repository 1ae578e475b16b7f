"""What a script depends on is what it imports, followed to the end."""

import pytest

from regional_lv import dependencies


def names(root, *modules, **options):
    found = dependencies.files(root / "src", modules, **options)
    return {path.split("regional_lv/")[-1] for path in found}


def test_imports_are_followed(root):
    found = names(root, "simulations")
    assert {"simulations.py", "mechanics/simulator.py", "mechanics/materials/base.py"} <= found
    assert {"geometry/mesh.py", "aha.py", "progress.py"} <= found
    assert not {"geometry/meshing.py", "measured.py", "plots/zones.py"} & found


def test_modules_can_be_left_out(root):
    assert "progress.py" not in names(root, "simulations", without={"progress"})


def test_unknown_module_is_named(root):
    with pytest.raises(ValueError, match=r"regional_lv\.nonsense"):
        names(root, "nonsense")

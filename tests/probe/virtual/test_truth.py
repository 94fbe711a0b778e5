"""Hidden truths: those of the library, those drawn, and mistakes in their files."""

import numpy as np
import pytest

from identify.model.cell import Cell
from identify.model.files import InputError
from probe.virtual.truth import Truth, draw_truth, read_truth, truth_path, truths


@pytest.fixture(scope="module")
def table2(arc_welder: Cell) -> Truth:
    return read_truth(truth_path("library:arc-welder"), arc_welder)


def test_table_2_changes_the_23_numbers_that_the_paper_prints(arc_welder, table2):
    changed = (table2.theta - arc_welder.theta) / arc_welder.robot.parameter_unit()

    assert np.count_nonzero(changed) == 23
    assert dict(zip(arc_welder.robot.parameters, changed, strict=True))["j2.theta"] == pytest.approx(-1.337)


def test_a_drawn_robot_differs_by_its_priors_and_is_the_same_for_the_same_seed(arc_welder):
    drawn = np.array([draw_truth(arc_welder, np.random.default_rng(i)).theta for i in range(400)])

    spread = np.std(drawn, axis=0) / arc_welder.prior
    assert spread.min() > 0.8
    assert spread.max() < 1.2
    assert np.array_equal(drawn[3], draw_truth(arc_welder, np.random.default_rng(3)).theta)


def test_a_truth_of_unknown_parameters_and_faces_is_refused_with_every_mistake(arc_welder, tmp_path):
    path = tmp_path / "truth.yaml"
    path.write_text("name: x\nparameters: {j2.thta: 1}\nfaces_mm: {top-lo: 0.1}\n")

    with pytest.raises(InputError) as error:
        read_truth(path, arc_welder)

    assert "truth.yaml:2" in str(error.value)
    assert "j2.theta" in str(error.value)
    assert "top-low" in str(error.value)


@pytest.mark.parametrize("name", truths())
def test_every_truth_of_the_library_is_read_for_the_cell_of_its_name(name, arc_welder):
    assert read_truth(truths()[name], arc_welder).name == name


def test_unknown_errors_of_a_truth_are_answered_with_the_nearest(tmp_path, arc_welder):
    (tmp_path / "truth.yaml").write_text("errors: [harmonic]\n")

    with pytest.raises(InputError, match="did you mean 'harmonics'"):
        read_truth(tmp_path / "truth.yaml", arc_welder)

"""`touchcal verify`: only what the fit has not seen."""

SIGMA = 0.05  # [mm]


def test_touches_of_the_fit_are_refused_as_verification(folder, touchcal):
    touchcal("identify", "touches.csv")

    code, _, err = touchcal("verify", "calibration.json", "touches.csv")

    assert code == 2
    assert "100 of 100 measurements were used in the fit" in err

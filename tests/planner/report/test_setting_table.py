"""What is said below a setting's pictures: numbers of hand-made margins."""

from plan_examples import plan, setting

from planner.report.setting_table import binding_sentence, focus_note


def with_margins(margins, requirements=None):
    one = setting((40.0, -180.0, 620.0), ["top front"])
    one = type(one)(**{**vars(one), "margins": margins})
    found = plan(
        settings=(one,),
        entities={"top front": [[0, 0, 60], [80, 0, 60]]},
        uninspectable={},
        requirements=requirements or {},
    )
    return found, one


def test_the_nearest_limit_comes_first():
    told = binding_sentence(*with_margins({"field_of_view_px": 10.24, "workspace_mm": 90.0}))
    # 10.24 px of half of 2048, 90 mm of half of 1800
    assert told.startswith(
        "Nearest to its limit: field of view, with 1 % of its room left; what is measured would"
    )
    assert told.endswith("Next: workspace 10 %, probability 50 %.")
    told = binding_sentence(*with_margins({"field_of_view_px": 0.0003}))
    assert told.startswith(
        "Nearest to its limit: field of view, with less than 0.01 % of its room left;"
    )


def test_a_margin_of_focus_within_the_uncertainty_of_the_place_is_told():
    # the camera's place has a standard deviation of 0.05 mm
    told = focus_note(*with_margins({"focus_mm": 0.1}))
    assert told.startswith("Focus: 0.1 mm of the depth of field are left")
    assert "0.05 mm" in told
    assert focus_note(*with_margins({"focus_mm": 0.16})) == ""
    # what is kept as a reserve is left, too
    assert focus_note(*with_margins({"focus_mm": 0.0}, {"focus_margin_mm": 0.2})) == ""
    assert focus_note(*with_margins({})) == ""

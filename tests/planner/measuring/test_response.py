"""Grey values and light: responses that are stated, read from files, and estimated from edges."""

import dataclasses
import io
import math
import struct
import zlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image, ImageCms
from scipy.special import ndtr

from aspectgraph import read_solid
from planner import (
    Backlight,
    Camera,
    Material,
    MeasureOptions,
    Measurer,
    Registration,
    read_plan,
)
from planner.camera.response import LINEAR, SRGB, Response, of_profile, stated_in_file
from planner.exceptions import CameraError
from planner.measuring.images import FILE, Picture
from planner.measuring.reading import Reading
from planner.measuring.response import (
    CURVED,
    EDGES,
    LEAST_CURVED,
    LEAST_SD,
    Curve,
    JudgedResponse,
    Places,
    PowerEstimate,
    Profiles,
    _left_text,
    _measured_curve,
    estimated_power,
    fitted_steps,
    is_clear,
    judge_response,
)
from planner.measuring.samples import profiles_of

EXAMPLES = Path(__file__).parents[3] / "examples"
CAMERA = Camera(12.0, (0.00345, 0.00345), (288, 180), 8.0, 300.0)
TILE = 36
SHARES = np.linspace(0.0, 1.0, 256)


def srgb_levels(light):
    """Levels of light by IEC 61966-2-1, the other way round than the code under test."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def gamma_levels(gamma):
    return lambda light: light ** (1 / gamma)


def video_levels(light):
    return (16 + 219 * light ** (1 / 2.2)) / 255


class Scene:
    """Steps of light of any direction and contrast, blurred by a Gaussian, with noise, each in a tile of an image.

    ``chamfer_px`` makes the steps double: what is between them has a light of its own, on average that of both. Of the
    edges, ``aligned`` run along rows or columns of pixels. ``exposure`` is the share of the light that arrives.
    """

    def __init__(
        self,
        seed,
        levels,
        bits=8,
        *,
        blur=0.76,
        noise=0.004,
        chamfer_px=0.0,
        edges=40,
        aligned=0,
        exposure=1.0,
    ):
        rng = np.random.default_rng(seed)
        v, u = np.mgrid[:TILE, :TILE]
        tiles = []
        centres = []
        across = []
        names = []
        for k in range(edges):
            turn = rng.uniform(0, 2 * np.pi)
            if k < aligned:
                turn = np.pi / 2 * rng.integers(4)
            way = np.array([np.cos(turn), np.sin(turn)])
            low, high = np.sort(rng.uniform(0.03, 0.9, 2))
            high = max(high, low + 0.1)
            centre = TILE / 2 + rng.uniform(-0.5, 0.5, 2)
            distance = (u - centre[0]) * way[0] + (v - centre[1]) * way[1]
            wide = chamfer_px * rng.uniform(0, 2)
            share = rng.uniform(0, 1)
            step = share * ndtr((distance + wide / 2) / blur)
            step += (1 - share) * ndtr((distance - wide / 2) / blur)
            tiles.append(low + (high - low) * step)
            along = np.arange(-10, 10.1, 2.5)[:, None] * [-way[1], way[0]]
            centres.append(centre + along + TILE * np.array([k % 8, k // 8]))
            across.append(np.tile(way, (len(along), 1)))
            names += [k] * len(along)
        light = np.vstack([np.hstack(tiles[i : i + 8]) for i in range(0, edges, 8)])
        light = exposure * light + rng.normal(0, noise, light.shape)
        self.white = 2.0**bits - 1
        self.levels = np.rint(levels(np.clip(light, 0, 1)) * self.white).astype(np.float32)
        self.blur = blur
        self.centres = np.concatenate(centres)
        self.across = np.concatenate(across)
        self.edge = np.array(names)

    def power(self, response):
        """Return the power that is left in the light of a response."""
        image = response.applied(self.levels, self.white)
        places, grey = profiles_of(image, self.centres, self.across, 1.0)
        blur = np.full(len(grey), self.blur)
        steps = fitted_steps(places, grey / self.white, blur, response)
        return estimated_power(steps, self.edge, np.zeros(len(self.edge), dtype=np.int64))

    def profiles(self):
        """Return the profiles as they are taken from a registered image."""
        picture = Picture("one", self.levels, self.white, 0.0, CAMERA)
        count = len(self.edge)
        sections = np.zeros(count, dtype=np.int64)
        blur = np.full(count, self.blur)
        return Profiles([picture], [Places(self.centres, self.across, self.edge, sections, blur)])


# Stated responses.


@pytest.mark.parametrize(
    "value", ["9", "0", "nan", "blue", True, [2.2], "missing.txt", "0 0; 1", "-2.2"]
)
def test_responses_that_are_refused(value):
    with pytest.raises(CameraError, match=r"^response must be .*\. Got") as caught:
        Response.of(value)
    assert "\n" not in str(caught.value)
    with pytest.raises(CameraError, match=r"^response must be"):
        MeasureOptions(Registration.none(), response=value)


def test_the_gamma_of_a_camera_menu_is_refused_with_the_one_that_is_meant():
    with pytest.raises(CameraError, match=r"gamma 0\.45 has 2\.2"):
        Response.of(0.45)


def test_a_response_is_the_inverse_of_what_the_camera_does():
    light = np.linspace(0, 1, 101)
    assert Response.of("srgb").light(srgb_levels(light)) == pytest.approx(light, abs=2e-5)
    assert Response.of(2.2).light(light ** (1 / 2.2)) == pytest.approx(light, abs=1e-12)
    assert Response.of("linear").light(light) == pytest.approx(light)
    assert Response.power(2.2, 16 / 235).light(
        (16 + 219 * light ** (1 / 2.2)) / 235
    ) == pytest.approx(light, abs=1e-12)


def test_a_file_of_levels_and_light_is_a_response(tmp_path):
    (tmp_path / "curve.csv").write_text("level,light\n0,0\n0.5,0.2\n1,1\n")
    camera = tmp_path / "camera.toml"
    camera.write_text(
        "focal_length_mm = 16\npixel_pitch_mm = [0.0069, 0.0069]\nresolution = [1224, 1024]\n"
        'f_number = 8\nfocus_distance_mm = 500\nresponse = "curve.csv"\n'
    )
    read = Camera.from_toml(camera)
    # a plan holds the rows: the file may go
    assert read.response == "0 0; 0.5 0.2; 1 1"
    assert Response.of(read.response).light(np.array([0.25, 0.75])) == pytest.approx([0.1, 0.6])
    assert Camera.from_dict(read.to_dict()) == read
    (tmp_path / "curve.csv").write_text("0 0\n0.5 0.6\n0.4 0.8\n1 1\n")
    with pytest.raises(CameraError, match=r"response must be a file of two columns that rise"):
        Camera.from_toml(camera)


def test_white_stays_where_it_is_and_clipping_is_judged_on_levels():
    levels = np.full((40, 60), 100, np.uint8)
    levels[:, 30:] = 252
    picture = Picture.of(
        "one", levels, dataclasses.replace(CAMERA, white_level=255, response="2.2")
    )
    assert picture.grey[0, 0] == pytest.approx(255 * (100 / 255) ** 2.2, rel=1e-5)
    # 252 of 255 is overexposed, though its light is 97.4 % of white's
    assert picture.clipped_share == 0.5
    assert picture.clipped_from <= picture.grey[0, -1] < 0.98 * 255


# What image files state.


def png(*chunks):
    """Return a PNG with chunks after its head."""
    stream = io.BytesIO()
    Image.fromarray(np.zeros((4, 5), np.uint8)).save(stream, "PNG")
    plain = stream.getvalue()
    at = 8 + 25
    added = b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        for name, body in chunks
    )
    return plain[:at] + added + plain[at:]


def stated(content):
    with Image.open(io.BytesIO(content)) as image:
        return stated_in_file(image.info, image.getexif())


def test_chunks_of_png_state_a_response():
    assert stated(png()) is None
    assert stated(png((b"gAMA", struct.pack(">I", 45455)))).text == "2.2"
    assert stated(png((b"gAMA", struct.pack(">I", 100000)))).is_linear
    assert stated(png((b"gAMA", struct.pack(">I", 45455)), (b"sRGB", b"\0"))) == SRGB
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    assert stated(png((b"iCCP", b"srgb\0\0" + zlib.compress(profile)))) == SRGB
    # what is no gamma, and no profile, states nothing
    assert stated(png((b"gAMA", struct.pack(">I", 1)))) is None
    assert stated(png((b"iCCP", b"bad\0\0" + zlib.compress(b"nothing" * 40)))) is None


def test_exif_states_srgb():
    exif = Image.Exif()
    exif[0x8769] = {0xA001: 1}
    stream = io.BytesIO()
    Image.fromarray(np.zeros((4, 5), np.uint8)).save(stream, "PNG", exif=exif)
    assert stated(stream.getvalue()) == SRGB


# g, a, b, c, d of a profile's fourth formula
SRGB_NUMBERS = [round(65536 * n) for n in (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)]


def grey_profile(curve):
    """Return an ICC profile of nothing but a curve of grey (ICC.1:2022, 7.3)."""
    table = struct.pack(">I4sII", 1, b"kTRC", 144, len(curve))
    return b"\0" * 128 + table + curve


@pytest.mark.parametrize(
    ("curve", "light"),
    [
        (b"curv\0\0\0\0" + struct.pack(">IH", 1, round(1.8 * 256)), lambda x: x**1.8),
        (b"curv\0\0\0\0" + struct.pack(">I", 0), lambda x: x),
        (b"curv\0\0\0\0" + struct.pack(">I3H", 3, 0, 16384, 65535), lambda x: np.interp(x, [0, 0.5, 1], [0, 0.25, 1])),
        (b"para\0\0\0\0" + struct.pack(">HHi", 0, 0, round(2.2 * 65536)), lambda x: x**2.2),
        (b"para\0\0\0\0" + struct.pack(">HH5i", 3, 0, *SRGB_NUMBERS), SRGB.light),
    ],
    ids=["gamma", "identity", "table", "power", "sRGB"],
)  # fmt: skip
def test_curves_of_profiles(curve, light):
    assert of_profile(grey_profile(curve)).light(SHARES) == pytest.approx(light(SHARES), abs=0.004)


# What edges show.


RESPONSES = [
    (lambda light: light, LINEAR),
    (gamma_levels(1.8), Response.power(1.8)),
    (gamma_levels(2.2), Response.power(2.2)),
    (srgb_levels, SRGB),
]


@pytest.mark.parametrize(("levels", "response"), RESPONSES, ids=["linear", "1.8", "2.2", "srgb"])
def test_in_light_nothing_is_left_within_the_stated_deviation(levels, response):
    cases = [(8, 0.4), (8, 0.76), (10, 0.76), (12, 1.5), (8, 2.0)]
    draws = [
        Scene(10 * seed + k, levels, bits, blur=blur).power(response)
        for k, (bits, blur) in enumerate(cases)
        for seed in range(3)
    ]
    errors = np.array([one.excess / one.sd for one in draws])
    # of 15 draws, 14.3 are expected within two deviations; P(11 or fewer) is 0.5 %
    assert (np.abs(errors) <= 2).sum() >= 12
    assert not any(is_clear(one) for one in draws)
    assert max(one.sd for one in draws) < 0.25


@pytest.mark.parametrize(("levels", "response"), RESPONSES[1:], ids=["1.8", "2.2", "srgb"])
def test_a_curve_is_never_taken_for_light(levels, response):
    for seed in range(6):
        assert is_clear(Scene(seed, levels).power(LINEAR))


@pytest.mark.parametrize("blur", [0.5, 0.6, 0.76])
def test_steps_along_pixel_rows_have_the_sensitivity_of_convex_l_ln_l(blur):
    # L ln L is convex: below the chord of a step, by at most its height for light from 0 to 1
    rng = np.random.default_rng(3)
    middles = 10 + rng.uniform(-0.5, 0.5, 30)
    rows = 0.8 - 0.77 * ndtr((np.arange(21.0) - middles[:, None]) / blur)
    profiles = []
    for middle, row in zip(middles, rows, strict=True):
        image = np.tile(row, (21, 1)) + rng.normal(0, 0.002, (21, 21))
        centre = np.array([[middle, 10.0]])
        places, light = profiles_of(image.astype(np.float32), centre, np.array([[1.0, 0.0]]), 1.0)
        profiles.append(light[0])
    steps = fitted_steps(places, np.array(profiles), np.full(30, np.hypot(blur, 0.3)))
    falling = steps.sensitivity[steps.good, 0]
    assert len(falling) > 20
    assert falling.min() > 0
    assert falling.max() < 1


@pytest.mark.parametrize("seed", range(6))
def test_edges_along_pixel_rows_are_no_gamma_and_hide_none(seed):
    for blur in (0.55, 0.7):
        scene = Scene(seed, lambda light: light, 12, blur=blur, noise=0.002, aligned=28)
        power = scene.profiles().power()
        assert not is_clear(power)
        assert abs(power.excess) < 2.5 * power.sd
    scene = Scene(seed, gamma_levels(2.2), 12, blur=0.7, noise=0.002, aligned=28)
    assert is_clear(scene.profiles().power())


def test_the_curve_is_recovered():
    cases = [
        (gamma_levels(1.8), Response.power(1.8)),
        (gamma_levels(2.2), Response.power(2.2)),
        (srgb_levels, SRGB),
        (video_levels, Response.power(2.2, 16 / 255)),
    ]
    errors = []
    for k, (levels, response) in enumerate(cases):
        for seed in range(2):
            curve = Scene(20 * seed + k, levels).profiles().curve()
            assert isinstance(curve, Curve)
            # light is right where the edges of the scene are
            middle = np.linspace(0.35, 0.95, 13)
            slope = np.gradient(np.log(curve.response.light(middle)), np.log(middle))
            true = np.gradient(np.log(response.light(middle)), np.log(middle))
            errors.append(np.abs(slope - true).mean() / curve.sd)
    assert np.median(errors) < 1.5
    assert max(errors) < 3.5


def test_chamfers_widen_the_deviation_and_make_no_gamma():
    sharp = [Scene(seed, lambda light: light).power(LINEAR) for seed in range(6)]
    broken = [Scene(seed, lambda light: light, chamfer_px=1.0).power(LINEAR) for seed in range(6)]
    assert np.mean([one.sd for one in broken]) > 1.1 * np.mean([one.sd for one in sharp])
    assert not any(is_clear(one) for one in broken)


def test_a_curve_that_may_be_a_line_is_no_gamma():
    """What rounded edges of 0.2 mm show in light is a power of 1.3 above a black of -0.12: nearly a line."""
    covariance = np.diag([0.07, 0.055]) ** 2
    assert not Curve(1.3, -0.12, covariance).is_bent
    assert Curve(2.4, -0.055, covariance).is_bent
    # at half of full exposure, sRGB is a gamma of 2.2
    assert Curve(2.4, -0.055, covariance).usual_gamma == pytest.approx(2.2, abs=0.05)


def test_the_darker_an_image_the_less_its_edges_show():
    """Grey values are light at each exposure, and 16 bits are hardly rounded: what differs from them is rounding."""
    deviations = []
    apart = []
    for seed in range(6):
        for exposure in (1.0, 0.5, 0.25, 0.125):
            dark = {"noise": 0.001, "exposure": exposure}
            profiles = Scene(seed, gamma_levels(1.0), **dark).profiles()
            fine = Scene(seed, gamma_levels(1.0), bits=16, **dark).profiles().power()
            power = profiles.power()
            spread = estimated_power(
                profiles.steps(), profiles._edge, profiles._section, profiles._phase
            ).sd
            assert not is_clear(power)
            assert abs(power.excess) < 3 * power.sd
            deviations.append(power.sd)
            apart.append(abs(power.excess - fine.excess) / math.sqrt(power.sd**2 - spread**2))
    by_exposure = np.mean(np.reshape(deviations, (6, 4)), axis=0)
    assert list(by_exposure) == sorted(by_exposure)
    # a deviation from two trials: half of the values of Student's t with 2 degrees of freedom are within 0.82
    assert 0.4 < np.median(apart) < 1.4


def test_too_few_edges_show_nothing():
    power = Scene(1, gamma_levels(2.2), edges=3).power(LINEAR)
    assert power == PowerEstimate(0.0, np.inf, power.edges)
    assert not is_clear(power)


# Measuring the example with its images bent.


@pytest.fixture(scope="module")
def measurer():
    plan = read_plan(EXAMPLES / "measured" / "plan.json")
    return Measurer(plan, read_solid(EXAMPLES / "nist_ctc_01_ap242.stp"))


@pytest.fixture(scope="module")
def images():
    folder = EXAMPLES / "measured" / "images"
    return {k: np.asarray(Image.open(folder / f"setting_0{k}.png")) for k in (1, 2)}


@pytest.fixture(scope="module")
def linear(measurer, images):
    return measurer.measure(images, MeasureOptions(Registration.own_edges()))


def bent(images, levels):
    return {k: np.rint(255 * levels(image / 255)).astype(np.uint8) for k, image in images.items()}


def test_of_light_nothing_is_said_and_u_contains_the_response(linear):
    assert not linear.notes
    for record in linear.responses.values():
        assert (record.curve, record.origin) == ("linear", "edges")
        assert abs(record.remaining_gamma - 1) < 3 * record.gamma_sd
    for result in linear:
        for reading in result.readings:
            assert 0 < reading.budget["response"] < reading.standard_uncertainty**2
            assert sum(reading.budget.values()) == pytest.approx(reading.standard_uncertainty**2)


@pytest.mark.parametrize(
    "levels", [gamma_levels(2.2), gamma_levels(1.8), srgb_levels], ids=["2.2", "1.8", "srgb"]
)
def test_bent_images_give_the_same_values_and_decisions(measurer, images, linear, levels):
    results = measurer.measure(bent(images, levels), MeasureOptions(Registration.own_edges()))
    measured = [result for result in results if result.measured]
    assert len(measured) >= 3
    for result in results:
        plain = linear[result.name]
        if not result.measured:
            assert "grey values are not proportional to light" in result.reason
            continue
        # 19 of 20 are to be within U
        assert abs(result.value - plain.value) < 1.25 * result.expanded_uncertainty
        assert result.decision == plain.decision
    assert "grey values are not proportional to light (gamma about" in results.notes[0]
    record = next(iter(results.to_dict()["response"].values()))
    assert record["from"] == EDGES


def test_a_stated_response_is_believed_and_contradicted(measurer, images, linear):
    curved = bent(images, gamma_levels(2.2))
    how = Registration.own_edges()
    results = measurer.measure(curved, MeasureOptions(how, response=2.2))
    assert not results.notes
    for result, plain in zip(results, linear, strict=True):
        assert abs(result.value - plain.value) < 0.35 * plain.expanded_uncertainty
        assert result.standard_uncertainty < plain.standard_uncertainty
    wrong = measurer.measure(curved, MeasureOptions(how, response="linear"))
    assert "edges contradict the stated response (linear)" in wrong.notes[0]


@pytest.mark.parametrize("stated", [2.2, "srgb", "0 0; 0.5 0.2; 1 1"])
def test_a_stated_response_of_images_that_are_light_is_contradicted(measurer, images, stated):
    """Light that is bent so much has no small power left, so that the grey values themselves are tested.

    Where edges are no longer found in such light, no value is stated, and the response is named.
    """
    how = Registration.own_edges()
    wrong = measurer.measure(images, MeasureOptions(how, response=stated))
    if any(result.measured for result in wrong):
        assert "edges contradict the stated response" in wrong.notes[0]
    else:
        assert all("check the stated response" in result.advice for result in wrong)
    right = measurer.measure(images, MeasureOptions(how, response="linear"))
    assert not [note for note in right.notes if "contradict" in note]


@pytest.mark.parametrize(("response", "power"), [("linear", 1.0), ("2.2", 2.2), ("srgb", 2.224)])
def test_the_power_at_half_of_full_exposure(response, power):
    """Of sRGB by its definition: ((0.5 + 0.055) / 1.055) ** 2.4 is 0.21404, and 0.5 ** 2.224 the same."""
    assert Response.of(response).power_at_half == pytest.approx(power, abs=1e-3)


def test_a_statement_of_a_file_is_tested(measurer, images, tmp_path, linear):
    for k, image in images.items():
        stream = io.BytesIO()
        Image.fromarray(image).save(stream, "PNG")
        plain = stream.getvalue()
        body = b"sRGB\0"
        chunk = struct.pack(">I", 1) + body + struct.pack(">I", zlib.crc32(body))
        (tmp_path / f"setting_0{k}.png").write_bytes(plain[:33] + chunk + plain[33:])
    results = measurer.measure(tmp_path, MeasureOptions(Registration.own_edges()))
    assert "the files state sRGB, but grey values are proportional to light" in results.notes[0]
    for result, plain in zip(results, linear, strict=True):
        assert result.value == pytest.approx(plain.value, abs=1e-9)


# What becomes of readings.


def reading(value, u):
    return Reading("a", "one", 0, value=value, standard_uncertainty=u, budget={"pose": u**2})


def test_light_on_metal_tells_no_response():
    """What edges show there is not asked: the images are measured as they are, and U allows for a gamma."""
    model = SimpleNamespace(
        edges=SimpleNamespace(
            area=Backlight((0, 0, 0), (9, 0, 0), (0, 9, 0), "", Material("metal"))
        )
    )
    judged = judge_response(model, {}, {}, 5.0)
    assert judged.gamma == 1
    assert not math.isfinite(judged.sd)
    assert not judged.note


def test_edges_that_no_response_explains_widen_u():
    """Light that changes next to edges, as of a ring near the part, makes them asymmetric as no gamma does."""
    power = PowerEstimate(excess=-1.06, sd=0.24, edges=10)
    profiles = SimpleNamespace(curve=lambda: None, power=lambda _: power)
    judged = _measured_curve(profiles, {}, "", is_broken=False)
    assert not judged.reason
    assert "uneven light or breaks: U allows for a gamma off by 0.8" in judged.note


def test_u_contains_what_other_responses_would_read():
    judged = JudgedResponse({}, 1.0, 0.05)
    counted = judged.counted(reading(10.0, 0.03), [reading(10.04, 0.03)])
    assert counted.standard_uncertainty == pytest.approx(0.05)
    assert counted.budget["response"] == pytest.approx(0.04**2)


def test_what_the_response_dominates_is_not_measured():
    reason = "grey values are not proportional to light"
    judged = JudgedResponse({}, 1.0, 0.05, reason=reason)
    assert judged.counted(reading(10.0, 0.03), [reading(10.05, 0.03)]).measured
    assert judged.counted(reading(10.0, 0.03), [reading(10.1, 0.03)]).reason == reason
    nothing = JudgedResponse({}, np.nan, np.inf, reason=reason)
    assert nothing.counted(reading(10.0, 0.03), []).reason == reason


def test_limits_are_in_order():
    assert 0 < LEAST_SD < CURVED < LEAST_CURVED
    assert FILE != EDGES


@pytest.mark.parametrize(
    ("gamma", "what_to_do"),
    [(2.2, "state response or switch gamma off"), (10.0, "so edges may be broken; state edges")],
)
def test_a_gamma_that_no_camera_has_points_to_broken_edges(gamma, what_to_do):
    power = PowerEstimate(excess=-1.0, sd=0.05, edges=9)
    curve = SimpleNamespace(
        sd=0.2, is_bent=True, usual_gamma=gamma, black=0.0, response=None, others=lambda: []
    )
    profiles = SimpleNamespace(curve=lambda: curve, power=lambda _: power)
    assert what_to_do in _measured_curve(profiles, {}, "", is_broken=False).note


@pytest.mark.parametrize(
    ("excess", "text"),
    [
        (-0.545, "gamma 2.2 ± 0.2 is left in its light"),
        (-0.95, "no gamma explains what they show, as if light was uneven next to them"),
        (4.0, "no gamma explains what they show, as if light was uneven next to them"),
    ],
)
def test_a_gamma_that_no_camera_has_is_not_named(excess, text):
    assert _left_text(PowerEstimate(excess, 0.05, 9)) == text

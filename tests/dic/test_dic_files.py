"""Fields between image files: real images with a known answer, the files written, and input that
cannot be used.
"""

from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
from blobs import Speckle
from command_line import rows_of
from scipy.interpolate import RegularGridInterpolator

from analysis.dic import Correlation
from analysis.saturation import end_of_scale
from app.files.correlating import PLANES, correlate_files
from app.files.grey_images import read_image
from app.system.errors import UserError

DATA = Path(__file__).parents[1] / "data" / "dic_challenge"


def save(path, image):
    cv2.imencode(path.suffix, image)[1].tofile(path)
    return path


def read_table(path):
    """Frame -> column -> array (ny, nx), and the centres x and y."""
    rows = rows_of(path)
    x, y = (sorted({float(row[name]) for row in rows}) for name in ("x_px", "y_px"))
    frames = {}
    for frame in sorted({int(row["frame"]) for row in rows}):
        part = sorted(
            (r for r in rows if int(r["frame"]) == frame),
            key=lambda r: (float(r["y_px"]), float(r["x_px"])),
        )
        numbers = {
            n: np.array([float(row[n]) for row in part]).reshape(len(y), len(x))
            for n in PLANES
            if n != "status"
        }
        frames[frame] = numbers | {
            "status": np.array([row["status"] for row in part]).reshape(len(y), len(x))
        }
    return frames, np.array(x), np.array(y)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bilder µ")
    speckle = Speckle((120, 160))
    return [
        save(folder / f"image {n}.png", speckle.image(1.2 * n, noise=1, seed=n)) for n in range(3)
    ]


@pytest.mark.parametrize("method", ["shared", "icgn", "direct"])
def test_a_real_tensile_test_agrees_with_a_peer(tmp_path, method):
    """DIC Challenge sample 12, displacements to 8 px; DICe's solution with the same box."""
    images = [DATA / f"sample12_{n}.tif" for n in ("03", "11")]
    correlate_files(
        DATA / "sample12_00.tif",
        images,
        tmp_path / "fields.csv",
        Correlation(method=method, box=27, step=5),
    )
    frames, x, y = read_table(tmp_path / "fields.csv")
    for frame, name in [(1, "03"), (2, "11")]:
        peer = np.loadtxt(DATA / f"sample12_{name}_dice.csv", delimiter=",", skiprows=1)
        for column, quantity in enumerate(("ux_px", "uy_px"), 2):
            ours = RegularGridInterpolator((y, x), frames[frame][quantity])(peer[:, 1::-1])
            difference = np.abs(ours - peer[:, column])
            assert np.median(difference) < 0.03
            assert np.percentile(difference, 95) < 0.15


@pytest.mark.parametrize("method", ["shared", "icgn", "direct"])
def test_real_speckle_under_changed_light_moves_by_a_tenth_of_a_pixel(tmp_path, method):
    """DIC Challenge sample 5: (0, 0) and (0.10, 0.10) px with contrast and brightness changed."""
    images = [DATA / f"sample5_{n}.tif" for n in ("000", "001")]
    correlate_files(
        DATA / "sample5_reference.tif", images, tmp_path / "fields.csv", Correlation(method=method)
    )
    frames, _, _ = read_table(tmp_path / "fields.csv")
    for frame, truth in [(1, 0.0), (2, 0.1)]:
        assert (frames[frame]["status"] == "ok").all()
        assert frames[frame]["ux_px"].mean() == pytest.approx(truth, abs=0.01)
        assert frames[frame]["uy_px"].mean() == pytest.approx(truth, abs=0.01)


def test_table_hdf5_and_arrays_hold_the_same_fields(pictures, tmp_path):
    progress = []
    for name in ("a.csv", "a.h5", "a.npz"):
        summary = correlate_files(
            pictures[0],
            pictures[1:],
            tmp_path / name,
            on_progress=lambda text, share: progress.append((text, share)),
        )
        assert (summary.frames, sum(summary.statuses.values())) == (2, 2 * summary.points)
    assert progress[-1] == ("done", 1.0)
    assert ("image 2.png", 0.5) in progress
    frames, x, y = read_table(tmp_path / "a.csv")
    header = "frame,x_px,y_px,ux_px,uy_px,status,zncc,ux_sd_px,uy_sd_px,iterations"
    assert (tmp_path / "a.csv").read_text(encoding="utf-8").splitlines()[0] == header
    with np.load(tmp_path / "a.npz", allow_pickle=False) as file:
        arrays = dict(file)
    np.testing.assert_array_equal(arrays["x_px"], x)
    np.testing.assert_array_equal(arrays["y_px"], y)
    assert (arrays["images"] == [str(path) for path in pictures[1:]]).all()
    assert arrays["status_names"][0] == "ok"
    assert (
        dict(arrays["settings"].tolist()).items()
        >= {"reference": str(pictures[0]), "method": "shared", "box": "20"}.items()
    )
    with h5py.File(tmp_path / "a.h5") as file:
        data = file[file.attrs["default"]]
        data = data[data.attrs["default"]]
        assert data.attrs["NX_class"] == "NXdata"
        assert list(data.attrs["axes"]) == ["frame", "y", "x"]
        np.testing.assert_array_equal(data["x"], x)
        np.testing.assert_array_equal(data["y"], y)
        np.testing.assert_array_equal(data["frame"], [1, 2])
        assert all(data[name].attrs["units"] == "px" for name in ("ux", "uy", "x", "y"))
        for n, frame in frames.items():
            for ours, theirs in zip(
                ("ux", "uy", "ux_errors", "uy_errors", "zncc", "status", "iterations"),
                PLANES,
                strict=True,
            ):
                if ours == "status":
                    assert ((data["status"][n - 1] == 0) == (frame["status"] == "ok")).all()
                else:
                    np.testing.assert_allclose(data[ours][n - 1], frame[theirs], atol=1e-6)
                np.testing.assert_array_equal(data[ours][n - 1], arrays[theirs][n - 1])
        assert np.nanmedian(data["ux"][1]) == pytest.approx(2.4, abs=0.02)
        assert np.nanmedian(data["ux_errors"]) == pytest.approx(summary.ux_std_px, rel=0.05)
        settings = file["entry/settings"]
        assert (
            settings["box"][()],
            settings["box"].attrs["units"],
            settings["method"].asstr()[()],
        ) == (20, "px", "shared")
    assert {path.name for path in tmp_path.iterdir()} == {"a.csv", "a.h5", "a.npz"}


def test_the_account_is_that_of_the_fields(pictures, tmp_path):
    """Points per second by the clock, medians by hand from the file, every lost point under its
    reason.
    """
    half = read_image(pictures[2])
    half[:60] = 90
    images = [pictures[1], save(tmp_path / "half.png", half)]
    summary = correlate_files(pictures[0], images, tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as file:
        arrays = dict(file)
    counts = np.bincount(arrays["status"].ravel(), minlength=len(arrays["status_names"]))
    assert summary.statuses == dict(
        zip(arrays["status_names"].tolist(), counts.tolist(), strict=True)
    )
    assert summary.statuses["low_contrast"] > 20
    for value, name in [
        (summary.ux_std_px, "ux_sd_px"),
        (summary.uy_std_px, "uy_sd_px"),
        (summary.zncc, "zncc"),
    ]:
        assert value == pytest.approx(
            np.mean([np.nanmedian(plane) for plane in arrays[name]]), rel=1e-6
        )
    assert 0.001 < summary.ux_std_px < 0.03
    assert (summary.updates, summary.drift_px) == (0, 0.0)
    assert summary.points_per_s > 100


def test_the_reference_is_updated_on_request_and_the_drift_reported(pictures, tmp_path):
    summary = correlate_files(
        pictures[0],
        pictures[1:] * 2,
        tmp_path / "a.npz",
        Correlation(update="every", update_every=2),
    )
    assert summary.updates == 2
    assert 0.002 < summary.drift_px < 0.05
    with np.load(tmp_path / "a.npz", allow_pickle=False) as file:
        assert np.nanmedian(file["ux_px"], axis=(1, 2)) == pytest.approx(
            [1.2, 2.4, 1.2, 2.4], abs=0.03
        )
        assert np.nanmedian(file["ux_sd_px"][2]) > 1.2 * np.nanmedian(file["ux_sd_px"][0])


@pytest.mark.parametrize("method", ["shared", "icgn"])
def test_a_mask_and_a_region_leave_the_rest_out(pictures, tmp_path, method):
    """Pixels that are masked change no bit of a box without them; points outside the region are
    named so.
    """
    usable = np.zeros((120, 160), np.uint8)
    usable[:, 80:] = 1
    mask = save(tmp_path / "mask.png", usable)
    settings = Correlation(method=method)
    whole, masked, part = (tmp_path / f"{name}.npz" for name in ("whole", "masked", "part"))
    correlate_files(pictures[0], pictures[1:], whole, settings)
    correlate_files(pictures[0], pictures[1:], masked, settings, mask=mask)
    correlate_files(pictures[0], pictures[1:], part, settings, roi=(30, 0, 100, 60))
    with np.load(whole) as a, np.load(masked) as b, np.load(part) as c:
        x, y = np.meshgrid(a["x_px"], a["y_px"])
        no_mask, no_region = (
            list(file["status_names"]).index("masked") == file["status"] for file in (b, c)
        )
        assert (no_mask == (x + 9.5 < 89.6)).all()  # more than half of its columns lie left of 80
        assert np.nanmedian(b["ux_px"][1]) == pytest.approx(2.4, abs=0.02)
        inside = (x >= 30) & (x <= 100) & (y <= 60)
        assert (no_region == ~inside).all()
        np.testing.assert_array_equal(a["ux_px"][:, inside], c["ux_px"][:, inside])
        assert (dict(b["settings"])["mask"], dict(c["settings"])["roi"]) == (
            str(mask),
            "30 0 100 60",
        )


@pytest.mark.slow
@pytest.mark.parametrize(("scale", "full_scale"), [(257, 0), (16, 4095)])
def test_images_of_twelve_and_sixteen_bits(tmp_path, scale, full_scale):
    """Twelve bits in a file of sixteen: saturation is seen, also if the full scale is not given."""
    speckle = Speckle((120, 160))
    deep = [
        np.minimum(
            speckle.image(1.2 * n, noise=1, seed=n).astype(np.uint16) * scale, full_scale or 65535
        )
        for n in range(2)
    ]
    deep[1][40:80, 60:100] = full_scale or 65535
    files = [save(tmp_path / f"{n}.tif", image) for n, image in enumerate(deep)]
    summary = correlate_files(
        files[0], files[1:], tmp_path / "scaled.npz", Correlation(full_scale=full_scale)
    )
    assert summary.statuses["saturated"] >= 4
    with np.load(tmp_path / "scaled.npz") as file:
        assert np.nanmedian(file["ux_px"]) == pytest.approx(1.2, abs=0.02)
    if full_scale:
        found = correlate_files(files[0], files[1:], tmp_path / "found.npz").statuses
        assert found["saturated"] == summary.statuses["saturated"]


def test_lost_points_are_nan_with_a_reason(pictures, tmp_path):
    blank = save(tmp_path / "blank.png", np.full((120, 160), 90, np.uint8))
    correlate_files(pictures[0], [blank], tmp_path / "a.csv")
    lines = (tmp_path / "a.csv").read_text(encoding="utf-8").splitlines()[1:]
    assert all(line.split(",")[3:6] == ["nan", "nan", "low_contrast"] for line in lines)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_grey_levels_are_read_as_they_were_stored(tmp_path, suffix, dtype):
    image = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, (20, 30)).astype(dtype)
    assert np.array_equal(read_image(save(tmp_path / f"grau ä{suffix}", image)), image)
    as_colour = save(tmp_path / f"rgb{suffix}", np.repeat(image[..., None], 3, axis=2))
    assert np.array_equal(read_image(as_colour), image)


def unusable(kind, pictures, folder):
    grey = read_image(pictures[1])
    path = folder / "bad.tif"
    if kind == "text":
        path.write_text("no image", encoding="utf-8")
    elif kind == "nothing":
        path.write_bytes(b"")
    elif kind == "truncated":
        path.write_bytes(cv2.imencode(".tif", grey)[1].tobytes()[:3000])
    elif kind == "colour":
        save(path, np.dstack([grey, grey, grey // 2]))
    elif kind == "size":
        save(path, grey[:-1])
    elif kind == "depth":
        save(path, grey.astype(np.uint16))
    return path


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("missing", "no such file"),
        ("text", "not an image"),
        ("nothing", "not an image"),
        ("truncated", "not an image"),
        ("colour", "colour image"),
        ("size", "160 x 119 uint8 found"),
        ("depth", "160 x 120 uint16 found"),
    ],
)
@pytest.mark.parametrize("ending", ["csv", "h5", "npz"])
def test_an_image_that_can_not_be_used_leaves_nothing_behind(
    pictures, tmp_path, kind, words, ending
):
    bad = unusable(kind, pictures, tmp_path)
    before = set(tmp_path.iterdir())
    with pytest.raises(UserError, match=words) as caught:
        correlate_files(pictures[0], [pictures[1], bad], tmp_path / f"fields.{ending}")
    assert str(bad) in str(caught.value)
    assert set(tmp_path.iterdir()) == before


def test_options_that_can_not_be_used_are_refused(pictures, tmp_path):
    mask = save(tmp_path / "mask.png", np.ones((119, 160), np.uint8))
    black = save(tmp_path / "black.png", np.zeros((120, 160), np.uint8))
    for images, output, settings, options, words in [
        ([], "a.csv", {}, {}, "there are no images to correlate with it"),
        (pictures, "a.txt", {}, {}, "ending '.txt'"),
        (pictures, "none/a.csv", {}, {}, "does not exist"),
        (pictures, "a.csv", {"box": 119}, {}, "do not fit"),
        (pictures, "a.csv", {}, {"mask": mask}, "mask.png: 160 x 119 uint8 found"),
        (pictures, "a.csv", {}, {"mask": tmp_path / "no.png"}, "no such file"),
        (pictures, "a.csv", {}, {"mask": black}, "no box"),
        (
            pictures,
            "a.csv",
            {},
            {"roi": (0, 0, 161, 50)},
            r"region from \(0, 0\) to \(161, 50\) px does not lie in an image of 160 x 120 px",
        ),
        (pictures, "a.csv", {}, {"roi": (50, 0, 50, 50)}, "bottom inside it"),
        (
            pictures,
            "a.csv",
            {"method": "direct"},
            {"roi": (0, 0, 50, 50)},
            "region asked of method 'direct'",
        ),
        (pictures, "a.csv", {"update": "every"}, {"mask": black}, "together with updates"),
    ]:
        with pytest.raises(UserError, match=words):
            correlate_files(
                pictures[0], images, tmp_path / output, Correlation(**settings), **options
            )
    assert set(tmp_path.iterdir()) == {mask, black}


@pytest.mark.parametrize("ending", ["csv", "h5", "npz"])
def test_an_existing_file_is_replaced_only_on_request(pictures, tmp_path, ending):
    output = tmp_path / f"a.{ending}"
    output.write_text("precious", encoding="utf-8")
    with pytest.raises(UserError, match="exists"):
        correlate_files(pictures[0], pictures[1:], output)
    with pytest.raises(UserError, match="no such file"):
        correlate_files(pictures[0], [tmp_path / "missing.png"], output, overwrite=True)
    assert output.read_text(encoding="utf-8") == "precious"
    correlate_files(pictures[0], pictures[1:], output, overwrite=True)
    assert output.stat().st_size > 1000
    assert list(tmp_path.iterdir()) == [output]


def overexposed(speckle, ux, top, scale=1):
    """A 16-bit picture of a camera of fewer bits, cut off at `top`."""
    grey = speckle.grey(ux, 0, contrast=700 * scale, level=2100 * scale)
    return np.clip(np.rint(grey), 0, top).astype(np.uint16)


@pytest.mark.parametrize(("top", "scale"), [(4095, 1), (1023, 0.25), (16383, 4), (3800, 1)])
def test_saturation_is_seen_where_the_grey_scale_ends_below_that_of_the_type(tmp_path, top, scale):
    speckle = Speckle((120, 160))
    paths = [tmp_path / f"{n}.tif" for n in range(2)]
    for n, path in enumerate(paths):
        save(path, overexposed(speckle, 0.7 * n, top, scale))
    settings = Correlation(box=20, step=10, max_saturated=0.02)
    found = correlate_files(paths[0], paths[1:], tmp_path / "a.npz", settings)
    given = Correlation(box=20, step=10, max_saturated=0.02, full_scale=top)
    known = correlate_files(paths[0], paths[1:], tmp_path / "b.npz", given)
    assert found.full_scale == top
    assert 0.005 < found.saturated < 0.2
    assert found.statuses == known.statuses
    assert found.statuses["saturated"] > 10
    assert known.full_scale == 0  # the user knows it


def test_a_picture_that_is_not_overexposed_has_no_end_of_its_grey_scale(tmp_path):
    speckle = Speckle((240, 320))
    for top, shift in ((65535, 0), (4095, 4)):
        grey = speckle.grey(0, 0, contrast=150, level=900)
        image = np.clip(np.rint(grey), 0, top).astype(np.uint16) << shift
        assert image.max() < 65535
        assert end_of_scale(image, 65535) == 65535
    clipped = np.full((50, 50), 255, np.uint8)
    assert end_of_scale(clipped, 255) == 255


def test_a_stack_is_not_one_image(pictures, tmp_path):
    stack = tmp_path / "stack.tif"
    cv2.imwritemulti(str(stack), [read_image(path) for path in pictures])
    with pytest.raises((UserError, ValueError), match="several images in one file"):
        read_image(stack)


def test_a_stack_and_a_folder_are_correlated_image_by_image(pictures, tmp_path):
    images = [read_image(path) for path in pictures]
    cv2.imwritemulti(str(tmp_path / "stack.tif"), images)
    settings = Correlation(box=20, step=10)
    one = correlate_files(pictures[0], pictures[1:], tmp_path / "files.npz", settings)
    stack = tmp_path / "stack.tif"
    cases = [(stack, []), (pictures[0].parent, []), (pictures[0], [pictures[1], stack])]
    for n, (first, others) in enumerate(cases):
        found = correlate_files(first, others, tmp_path / f"{n}.npz", settings)
        assert found.frames == (4 if n == 2 else 2)
        assert n == 2 or found.statuses == one.statuses
    with np.load(tmp_path / "files.npz") as a, np.load(tmp_path / "0.npz") as b:
        np.testing.assert_array_equal(a["ux_px"], b["ux_px"])
        assert str(b["images"][0]) == f"{tmp_path / 'stack.tif'}, page 1"


def test_a_picture_that_is_turned_over_has_no_displacements(tmp_path):
    image = Speckle((120, 160)).image()
    rest, turned = (
        save(tmp_path / "rest.png", image),
        save(tmp_path / "turned.png", image[::-1, ::-1]),
    )
    summary = correlate_files(rest, [turned], tmp_path / "fields.npz")
    assert summary.statuses["ok"] == 0
    assert summary.statuses["decorrelated"] > 50

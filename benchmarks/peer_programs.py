"""Programs for image correlation that correlate a whole series at once: run by the Python of the
environment in which they and psutil are installed, which need not have SlipScope.

    PYTHON benchmarks/peer_programs.py NAME FOLDER

FOLDER/frames.npy holds the reference and the frames, (n, rows, columns), uint8. FOLDER/fields.npz
gets the arrays x, y, ux, uy, (n - 1, points), NaN where a point is lost, and the processor seconds
of a frame. Each program measures boxes of 20 or 21 px every 10 px (al-dic: every 8 px, its step is
a power of two), to 0.01 px or finer, on one core, and is warmed up on a small part of two frames.
"""

import resource
import sys
import tempfile
import threading
import time
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np

assert sys.platform != "win32", "it asks what a system of POSIX knows of a process"

EDGE = 4  # px around the boxes


def pyvale(frames, folder):
    """Affine boxes, cubic B-splines, IC-LM from a multi-window search, spread by reliability."""
    from pyvale import dic

    usable = np.zeros(frames[0].shape, bool)
    usable[EDGE:-EDGE, EDGE:-EDGE] = True
    rows, columns = frames[0].shape
    seed = [(columns // 20 * 10, rows // 20 * 10)]
    dic.calculate_2d(
        frames[0], frames[1:], usable, seed, 21, 10, num_threads=1, max_displacement=16,
        precision=1e-3, image_filter_kernel=1, output_below_threshold=True, print_level=0,
        output_basepath=folder,
    )  # fmt: skip
    return folder


def read_pyvale(folder):
    """Its tables: one file a frame."""
    for file in sorted(Path(folder).iterdir()):
        heads = [h.strip(' "\n') for h in file.open().readline().split(",")]
        used = [heads.index(h) for h in ("subset_x", "subset_y", "disp_u", "disp_v", "cost_zncc")]
        x, y, ux, uy, zncc = np.loadtxt(file, delimiter=",", skiprows=1, usecols=used).T
        good = np.where(zncc > 0.5, 1.0, np.nan)
        yield x, y, good * ux, good * uy


def sun_dic(frames, folder):
    """Affine boxes, quintic splines, IC-GN."""
    import cv2
    from sundic import sundic
    from sundic.settings import Settings

    images = Path(folder, "images")
    images.mkdir()
    for n, frame in enumerate(frames):
        cv2.imwrite(str(images / f"{n:03d}.tif"), frame)
    rows, columns = frames[0].shape
    settings = Settings()
    for key, value in {
        "ImageFolder": str(images), "CPUCount": 1, "SubsetSize": 21, "StepSize": 10,
        "ShapeFunctions": "Affine", "InterpolationOrder": 5, "GaussianBlurSize": 0,
        "ConvergenceThreshold": 1e-2, "NZCCThreshold": 1.1, "MaxIterations": 50,
        "ROI": [EDGE, EDGE, columns - 2 * EDGE, rows - 2 * EDGE], "DatumImage": 0,
        "TargetImage": -1, "Increment": 1, "ReferenceStrategy": "Absolute",
    }.items():  # fmt: skip
        setattr(settings, key, value)
    return sundic.planarDICLocal(settings, str(Path(folder, "result.sdic")))


def read_sun_dic(planes):
    """Arrays (ny, nx, quantities) of the frames."""
    from sundic.sundic import CompID

    columns = CompID.XCoordID, CompID.YCoordID, CompID.XDispID, CompID.YDispID
    for plane in planes:
        yield tuple(np.asarray(plane[:, :, c], float).ravel() for c in columns)


def al_dic(frames, folder, most=3):
    """Augmented-Lagrangian: IC-GN of each box, made to agree by finite elements."""
    from al_dic.core.config import dicpara_default
    from al_dic.core.data_structures import GridxyROIRange
    from al_dic.core.pipeline import run_aldic

    rows, columns = frames[0].shape
    inside = GridxyROIRange(gridx=(16, columns - 17), gridy=(16, rows - 17))
    how = dicpara_default(
        winsize=20, winstepsize=8, winsize_min=8, admm_max_iter=most, tol=1e-2, cluster_no=0,
        img_size=(rows, columns), gridxy_roi_range=inside, size_of_fft_search_region=16,
        init_guess_mode="fft", reference_mode="accumulative", show_plots=False,
    )  # fmt: skip
    images = [frame / 255.0 for frame in frames]
    return run_aldic(how, images, [np.ones(f.shape) for f in frames], compute_strain=False)


def read_al_dic(found):
    """Displacements at the nodes of its mesh, x and y in turn."""
    for mesh, field in zip(found.result_fe_mesh_each_frame, found.result_disp, strict=True):
        x, y = mesh.coordinates_fem.T
        u = np.asarray(field.U)[: 2 * x.size]
        yield x, y, u[0::2], u[1::2]


PROGRAMS = {
    "pyvale": (pyvale, read_pyvale),
    "sun-dic": (sun_dic, read_sun_dic),
    "al-dic": (al_dic, read_al_dic),
}


class Cpu:
    """Processor seconds of this process and of its children, which may end meanwhile."""

    def __init__(self):
        self.most = self._children()
        self.start = time.process_time() + self.most
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self._watch, daemon=True)
        self.thread.start()

    def _watch(self):
        while not self.ended.wait(0.2):
            self.most = max(self.most, self._children())

    @staticmethod
    def _children():
        import psutil

        spent = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
        for process in psutil.Process().children(recursive=True):
            try:
                spent += sum(process.cpu_times()[:2])
            except psutil.Error:
                continue
        return spent

    def seconds(self):
        """Since this object was made."""
        self.ended.set()
        self.thread.join()
        return time.process_time() + max(self.most, self._children()) - self.start


def main(name, place):
    """Correlate and write."""
    correlate, read = PROGRAMS[name]
    frames = np.load(Path(place, "frames.npy"))
    with redirect_stdout(sys.stderr), tempfile.TemporaryDirectory() as folder:
        small, whole = Path(folder, "small"), Path(folder, "whole")
        small.mkdir()
        whole.mkdir()
        correlate(np.ascontiguousarray(frames[:2, :256, :256]), str(small))
        cpu = Cpu()
        found = correlate(frames, str(whole))
        spent = cpu.seconds() / (len(frames) - 1)
        fields = [np.stack(arrays) for arrays in zip(*read(found), strict=True)]
    arrays = dict(zip(("x", "y", "ux", "uy"), fields, strict=True))
    np.savez(Path(place, "fields.npz"), seconds=spent, **arrays)


if __name__ == "__main__":
    main(*sys.argv[1:])

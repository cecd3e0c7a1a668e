"""Images, videos and meshes in a raster and a vector view of the same data.

Pictures are NumPy arrays of ``uint8``, ``uint16`` or ``float32`` (0 to 1), with the shape (rows,
columns) or (rows, columns, channels): gray, gray and alpha, RGB or RGBA. Pictures of Pillow are
accepted, too. Results come back in the samples and channels that went in; transparency that is new
adds a channel. Colors are sRGB unless ``color_space="linear"`` says that floats are linear light.

Points are ``(x, y)`` in pixels from the upper left corner, with pixel centers at half-integers: the
middle of the first pixel is ``(0.5, 0.5)``. For points of OpenCV, which counts from the middle of
the first pixel, pass ``pixel_centers="integer"`` where it is offered, or add 0.5.

Options have the names, ranges and defaults of the command line. Those that are wrong raise
``ValueError``, files that are missing ``FileNotFoundError``, and tasks without a result
:class:`Error`, each with one sentence that says what, where and what to do. Work runs on all cores
with the interpreter unlocked, stops at Ctrl-C, and reports its progress to ``progress``: ``True``
for a bar of tqdm, or a callable that takes the phase, the units that are done and their total.
:func:`set_device` moves two-color pixels and warps to a GPU.
"""

from ._options import Picture, set_device
from ._ravec import OPERATIONS, Error, __version__, set_threads
from .clips import Clip, Plate, Track
from .completion import FragmentIndex, Retouch, complete
from .matting import matte
from .meshes import Mesh, boolean, offset
from .mosaics import Catalogue, mosaic
from .pictures import (
    TwoColorField,
    abstract,
    antialias,
    brush,
    clean,
    enlarge,
    sharpen,
    smooth,
    twocolor,
)
from .planes import Homography, PlaneProposals, Rectified, Snapped, match, propose, rectify, snap
from .recipes import Result, run
from .retargeting import Retargeter, retarget

__all__ = [
    "OPERATIONS",
    "Catalogue",
    "Clip",
    "Error",
    "FragmentIndex",
    "Homography",
    "Mesh",
    "Picture",
    "PlaneProposals",
    "Plate",
    "Rectified",
    "Result",
    "Retargeter",
    "Retouch",
    "Snapped",
    "Track",
    "TwoColorField",
    "__version__",
    "abstract",
    "antialias",
    "boolean",
    "brush",
    "clean",
    "complete",
    "enlarge",
    "match",
    "matte",
    "mosaic",
    "offset",
    "propose",
    "rectify",
    "retarget",
    "run",
    "set_device",
    "set_threads",
    "sharpen",
    "smooth",
    "snap",
    "twocolor",
]

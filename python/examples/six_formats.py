"""One photo in six formats.

    python six_formats.py [PHOTO] [FOLDER]

Without a photo, a built-in scene is used. Cells begin with # %%: notebooks and editors show their pictures below them.
"""

# %% Read a photo, or draw a scene
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

import ravec

arguments = [argument for argument in sys.argv[1:] if not argument.startswith("-")]
folder = Path(arguments[1] if len(arguments) > 1 else tempfile.mkdtemp())
folder.mkdir(parents=True, exist_ok=True)
if arguments:
    photo = np.asarray(Image.open(arguments[0]).convert("RGB"))
else:
    scene = {"scenes": ["street"], "width": 960, "height": 640}
    ravec.run({"operation": "scenes", "out": str(folder), "params": scene})
    photo = np.asarray(Image.open(folder / "street.png").convert("RGB"))
print(f"{photo.shape[1]} x {photo.shape[0]} pixels")

# %% Analyze it once
retargeter = ravec.Retargeter(photo)

# %% Ask for each format: milliseconds, with objects in shape and lines straight
height = photo.shape[0]
formats = {
    "square": (height, height),
    "portrait 4:5": (height * 4 // 5, height),
    "story 9:16": (height * 9 // 16, height),
    "wide 16:9": (height * 16 // 9, height),
    "banner 3:1": (height * 3 // 2, height // 2),
    "half": (photo.shape[1] // 2, height // 2),
}
pictures = {name: retargeter.picture(*size) for name, size in formats.items()}

# %% Look at one, and write them all
for name, picture in pictures.items():
    path = folder / f"{name.replace(' ', '_').replace(':', 'x')}.png"
    Image.fromarray(picture).save(path)
    print(f"{name}: {picture.shape[1]} x {picture.shape[0]} -> {path}")
pictures["square"]

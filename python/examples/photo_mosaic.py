"""A mosaic of one's own photos.

    python photo_mosaic.py [PHOTO FOLDER_OF_PHOTOS [FOLDER]]

Without photos, parts of built-in scenes stand for them.
"""

# %% A picture, and photos to make it of
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

import ravec

arguments = [argument for argument in sys.argv[1:] if not argument.startswith("-")]
folder = Path(arguments[2] if len(arguments) > 2 else tempfile.mkdtemp())
folder.mkdir(parents=True, exist_ok=True)
if len(arguments) > 1:
    photo = np.asarray(Image.open(arguments[0]).convert("RGB"))
    photos = Path(arguments[1])
else:
    names = ["still-life", "street", "facade", "floor"]
    ravec.run({"operation": "scenes", "out": str(folder), "params": {"scenes": names, "width": 960, "height": 720}})
    photo = np.asarray(Image.open(folder / "still-life.png").convert("RGB"))
    photos = folder / "photos"
    photos.mkdir(exist_ok=True)
    random = np.random.default_rng(1)
    for index in range(400):
        scene = Image.open(folder / f"{names[index % 4]}.png").convert("RGB")
        side = int(random.integers(60, 240))
        left, top = int(random.integers(0, 960 - side)), int(random.integers(0, 720 - side))
        scene.crop((left, top, left + side, top + side)).resize((64, 64)).save(photos / f"{index:03}.jpg")

# %% A catalogue of the photos, which is kept in a file for the next mosaic
catalogue = ravec.Catalogue(folder / "photos.ravec")
catalogue.add(photos)
print(catalogue.stats())

# %% The mosaic, in colors as they are
mosaic = ravec.mosaic(photo, catalogue, tiles=48, tile_size=32, min_repeat_distance=3, crop="center")
Image.fromarray(mosaic).save(folder / "mosaic.jpg")
print(f"{mosaic.shape[1]} x {mosaic.shape[0]} pixels -> {folder / 'mosaic.jpg'}")
mosaic

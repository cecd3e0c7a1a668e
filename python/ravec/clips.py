"""Clips: planes that are followed, backgrounds, mattes and edits of shots."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _ravec
from ._options import (
    ImageLike,
    PathLike,
    Picture,
    PixelCenters,
    Points,
    Progress,
    as_array,
    corners,
    operate,
    picture,
    report_of,
    without_none,
)

#: A range of frames from 0, such as ``(100, 200)`` without frame 200, or a text such as ``"1.5s..4s"``.
Frames = tuple[int, int] | str


def _range(frames: Frames | None) -> str | None:
    return frames if frames is None or isinstance(frames, str) else f"{frames[0]}..{frames[1]}"


def _quad(quad: Points | None) -> str | None:
    return None if quad is None else corners(quad, 4)


class Track:
    """Planes that were followed through a clip, as the command line keeps them in a JSON file."""

    def __init__(self, source: PathLike | Mapping[str, Any]) -> None:
        if isinstance(source, Mapping):
            self._data = dict(source)
        else:
            self._data = json.loads(Path(os.fspath(source)).read_text(encoding="utf-8"))
        #: The report of the tracking; empty for a track of a file.
        self.report: dict[str, Any] = {}

    def _plane(self, plane: int) -> dict[str, Any]:
        planes = self._data.get("planes") or [self._data]
        if not 1 <= plane <= len(planes):
            raise ValueError(f"the track has {len(planes)} planes, numbered from 1, and not {plane}")
        found: dict[str, Any] = planes[plane - 1]
        return found

    def corners(self, plane: int = 1) -> NDArray[np.float64]:
        """The corners in each frame: an array of shape (frames, 4, 2)."""
        return np.asarray(self._plane(plane)["corners"], dtype=np.float64).reshape(-1, 4, 2)

    def frame_from_reference(self, plane: int = 1) -> NDArray[np.float64]:
        """The homography of each frame: an array of shape (frames, 3, 3)."""
        return np.asarray(self._plane(plane)["frame_from_reference"], dtype=np.float64).reshape(-1, 3, 3)

    def states(self, plane: int = 1) -> list[str]:
        """For each frame: tracked, weak or lost."""
        return list(self._plane(plane)["state"])

    def first(self, plane: int = 1) -> int:
        """The number of the first frame in the track."""
        return int(self._plane(plane).get("first", 0))

    def to_json(self) -> str:
        """The track as the command line keeps it."""
        return json.dumps(self._data)

    def save(self, path: PathLike) -> None:
        """Writes the track as JSON."""
        Path(os.fspath(path)).write_text(self.to_json(), encoding="utf-8")

    def __repr__(self) -> str:
        planes = len(self._data.get("planes") or [self._data])
        return f"<ravec.Track of {planes} planes in {len(self.states())} frames>"


class Plate(NamedTuple):
    """The background of a shot without what moves before it."""

    #: The background; transparent beyond all frames.
    picture: Picture
    #: White was seen in some frame, black is invented.
    seen: Picture
    #: White where all frames agree.
    certainty: Picture
    #: The report: figures and warnings.
    report: dict[str, Any]


TrackLike = Track | PathLike | None


class Clip:
    """A clip: a file, a folder of pictures, or a pattern such as ``frame_%04d.png``.

    Clips stay where they are: operations read frame by frame, and write the clip that is their first argument. Formats
    other than numbered pictures, Y4M, GIF and H.264 in MP4 need FFmpeg.

    Points are in pixels, and the middle of the first one is (0.5, 0.5) unless ``pixel_centers`` is ``"integer"``.
    """

    def __init__(self, path: PathLike) -> None:
        #: The path or pattern.
        self.path = os.fspath(path)
        #: The report of the operation that wrote the clip; empty for other clips.
        self.report: dict[str, Any] = {}
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    @classmethod
    def from_frames(cls, frames: Iterable[ImageLike]) -> Clip:
        """A clip of pictures of equal size, kept in a temporary folder as long as the object lives."""
        folder = tempfile.TemporaryDirectory(prefix="ravec-")
        count = 0
        for count, frame in enumerate(frames, 1):
            content = _ravec.png(np.ascontiguousarray(as_array(frame)))
            Path(folder.name, f"frame_{count - 1:06}.png").write_bytes(content)
        if not count:
            raise ValueError("a clip has at least one frame")
        clip = cls(folder.name)
        clip._folder = folder
        return clip

    def _run(
        self,
        operation: str,
        fields: Mapping[str, Any],
        params: Mapping[str, Any],
        inputs: Mapping[str, Any] | None = None,
        progress: Progress = None,
    ) -> _ravec.Outcome:
        given = {"input": self.path, **fields}
        return operate(operation, given, params=params, inputs=inputs, progress=progress)

    def _to(
        self,
        target: PathLike,
        operation: str,
        fields: Mapping[str, Any],
        params: Mapping[str, Any],
        inputs: Mapping[str, Any] | None = None,
        progress: Progress = None,
    ) -> Clip:
        path = os.fspath(target)
        outcome = self._run(operation, {**fields, "output": path}, params, inputs, progress)
        made = Clip(path)
        made.report = report_of(outcome)
        return made

    def info(self, *, count: bool = False) -> dict[str, Any]:
        """Size, rate, number of frames and formats; ``count`` reads all frames."""
        found: dict[str, Any] = report_of(self._run("video info", {}, {"count": count}))["result"]
        return found

    def convert(
        self,
        target: PathLike,
        *,
        frames: Frames | None = None,
        size: str | None = None,
        rate: str | float | None = None,
        codec: str | None = None,
        quality: int | None = None,
        lossless: bool | None = None,
        progress: Progress = None,
    ) -> Clip:
        """Writes the clip in the format of the name of ``target``; a pattern writes numbered pictures.

        :param frames: frames to keep
        :param size: as in ``"1280x720"``, ``"1280x"`` or ``"50%"``
        :param rate: constant rate in frames a second
        :param codec: such as ``h264``, ``prores`` or ``ffv1``
        :param quality: quality of a lossy clip, 0 to 100
        """
        params = {
            "frames": _range(frames),
            "size": size,
            "rate": None if rate is None else str(rate),
            "encoding": _encoding(codec, quality, lossless),
        }
        return self._to(target, "video convert", {}, params, None, progress)

    def track(
        self,
        *quads: Points,
        reference: int | None = None,
        frames: Frames | None = None,
        region: Literal["quad", "frame"] | None = None,
        precision: Literal["fast", "normal", "dense"] | None = None,
        cuts: Sequence[int] = (),
        corrections: Mapping[int, Points] | None = None,
        mask: ImageLike | None = None,
        track: TrackLike = None,
        pixel_centers: PixelCenters | None = None,
        progress: Progress = None,
    ) -> Track:
        """Follows planes, each given by the corners of a rectangle on it in the reference frame.

        :param quads: four points each, in turn from the upper left one clockwise
        :param reference: number of the reference frame; by default the first one
        :param region: pixels that are tracked: the inside of the corners, or the whole frame
        :param precision: number of pixels that are compared
        :param cuts: frames with which a new shot begins
        :param corrections: corners that were set by hand, by the number of the frame
        :param mask: the plane in the reference frame, white on black
        :param track: a track to correct, in place of tracking
        """
        fields: dict[str, Any] = {"output": "@track"}
        inputs: dict[str, Any] = {}
        if mask is not None:
            fields["mask"], inputs["@mask"] = "@mask", as_array(mask)
        with _track_file(track, fields):
            params = {
                "quads": [corners(quad, 4) for quad in quads] or None,
                "reference": reference,
                "frames": _range(frames),
                "region": region,
                "precision": precision,
                "cuts": list(cuts) or None,
                "corrections": [f"{frame}:{corners(quad, 4)}" for frame, quad in (corrections or {}).items()] or None,
                "pixel_centers": pixel_centers,
            }
            outcome = self._run("track", fields, params, inputs, progress)
        found = Track(json.loads(outcome.text("@track")))
        found.report = report_of(outcome)
        return found

    def stabilize(
        self,
        target: PathLike,
        *,
        track: TrackLike = None,
        mode: Literal["plane", "smooth"] | None = None,
        strength: float | None = None,
        max_crop: float | None = None,
        border: Literal["black", "repeat", "last"] | None = None,
        plane: int | None = None,
        codec: str | None = None,
        quality: int | None = None,
        progress: Progress = None,
    ) -> Clip:
        """Writes the clip with a plane that stands still, or whose motion is smooth.

        :param track: a track of the plane; by default the whole picture is tracked
        :param strength: for smooth: motion faster than this period goes, in seconds
        :param max_crop: for smooth: maximum share that is cut off on each side
        """
        fields: dict[str, Any] = {}
        with _track_file(track, fields):
            params = {
                "mode": mode,
                "strength": strength,
                "max_crop": max_crop,
                "border": border,
                "plane": plane,
                "encoding": _encoding(codec, quality, None),
            }
            return self._to(target, "stabilize", fields, params, None, progress)

    def plate(
        self,
        *,
        track: TrackLike = None,
        pad: int | None = None,
        quad: Points | None = None,
        plane: int | None = None,
        frames: Frames | None = None,
        marks: Sequence[str] = (),
        unseen: Literal["completed", "smooth", "transparent"] | None = None,
        pixel_centers: PixelCenters | None = None,
        progress: Progress = None,
    ) -> Plate:
        """The background, from what is seen of it in all frames.

        A camera that seems to move, without a track, is a warning in the report.

        :param track: a track of the background; by default the camera stands still
        :param pad: pixels by which the plate is larger than a frame on each side
        :param quad: a rectangle on the plane: what is invented follows its perspective
        :param marks: strokes in frames, as in ``"40:background:6:100,80,140,90"`` with their radius
        :param unseen: content of places that no frame shows
        """
        fields: dict[str, Any] = {"output": "@plate", "seen": "@seen", "certainty": "@certainty"}
        with _track_file(track, fields):
            params = {
                "pad": pad,
                "quad": _quad(quad),
                "plane": plane,
                "frames": _range(frames),
                "marks": list(marks) or None,
                "unseen": unseen,
                "pixel_centers": pixel_centers,
            }
            outcome = self._run("plate", fields, params, None, progress)
        made, seen, certainty = (picture(outcome.picture(name)) for name in ("@plate", "@seen", "@certainty"))
        return Plate(made, seen, certainty, report_of(outcome))

    def matte(
        self,
        target: PathLike,
        plate: ImageLike,
        *,
        track: TrackLike = None,
        content: Literal["alpha", "foreground"] | None = None,
        pad: int | None = None,
        plane: int | None = None,
        marks: Sequence[str] = (),
        snap: float | None = None,
        shadows: Literal["foreground", "keep", "soften", "drop"] | None = None,
        progress: Progress = None,
    ) -> Clip:
        """Writes a clip of the alpha of the foreground, or of its colors with alpha.

        :param plate: the background, as of :meth:`plate`; transparent pixels are not known
        :param pad: pixels by which the plate is larger than a frame on each side
        :param marks: strokes in frames, as in ``"40:foreground:6:100,80,140,90"`` with their radius
        """
        fields: dict[str, Any] = {"plate": "@plate"}
        with _track_file(track, fields):
            params = {
                "content": content,
                "pad": pad,
                "plane": plane,
                "marks": list(marks) or None,
                "matte": without_none({"snap": snap, "shadows": shadows}) or None,
            }
            return self._to(target, "matte", fields, params, {"@plate": as_array(plate)}, progress)

    def remove(
        self,
        target: PathLike,
        plate: ImageLike,
        matte: Clip | PathLike,
        *,
        grain: Literal["matched", "none"] | None = None,
        **shot: Any,
    ) -> Clip:
        """Writes the clip without its foreground. ``shot`` as in :meth:`replace`.

        :param grain: the background gets the grain of the clip, or none
        """
        return self._edit(target, "video remove", plate, matte, {}, {"grain": grain}, {}, shot)

    def replace(
        self,
        target: PathLike,
        plate: ImageLike,
        matte: Clip | PathLike,
        image: ImageLike,
        *,
        quad: Points | None = None,
        image_quad: Points | None = None,
        **shot: Any,
    ) -> Clip:
        """Writes the clip with a picture on the background, in its light, behind the foreground.

        :param quad: where the picture lies in the reference frame; by default the whole frame
        :param image_quad: the points of the picture that lie there; by default its corners
        :param shot: ``track`` and ``plane`` of the background, ``pad`` of the plate, ``pixel_centers``, ``codec`` and
            ``quality`` of the clip, ``progress``
        """
        params = {"quad": _quad(quad), "image_quad": _quad(image_quad)}
        inputs = {"@image": as_array(image)}
        return self._edit(target, "video replace", plate, matte, {"image": "@image"}, params, inputs, shot)

    def enhance(
        self,
        target: PathLike,
        plate: ImageLike,
        matte: Clip | PathLike,
        photo: ImageLike,
        *,
        quad: Points | None = None,
        blur: Literal["none", "matched"] | None = None,
        **shot: Any,
    ) -> Clip:
        """Writes the clip with the background of a better photo of it. ``shot`` as in :meth:`replace`.

        :param quad: corners of the photo in the reference frame; by default they are found
        :param blur: of the photo: none, or that of each frame
        """
        inputs = {"@photo": as_array(photo)}
        params = {"quad": _quad(quad), "blur": blur}
        return self._edit(target, "video enhance", plate, matte, {"photo": "@photo"}, params, inputs, shot)

    def paste(
        self,
        target: PathLike,
        plate: ImageLike,
        matte: Clip | PathLike,
        into: Clip | PathLike,
        *,
        into_track: PathLike | None = None,
        into_matte: Clip | PathLike | None = None,
        quad: Points | None = None,
        into_quad: Points | None = None,
        shadow: float | None = None,
        **shot: Any,
    ) -> Clip:
        """Writes another clip with the foreground of this one. ``shot`` as in :meth:`replace`.

        :param into: the other clip
        :param into_track: file of a track of the other clip's plane
        :param into_matte: what stays before the foreground there
        :param quad: a rectangle on the plane of this clip
        :param into_quad: where it lies in the other one
        :param shadow: strength of a shadow on the ground, 0 to 1
        """
        fields = {"into": _path(into), "into_track": into_track and os.fspath(into_track), "into_matte": _path(into_matte)}
        params = {"quad": _quad(quad), "into_quad": _quad(into_quad), "shadow": shadow}
        return self._edit(target, "video paste", plate, matte, fields, params, {}, shot)

    def _edit(
        self,
        target: PathLike,
        operation: str,
        plate: ImageLike,
        matte: Clip | PathLike,
        fields: Mapping[str, Any],
        params: Mapping[str, Any],
        inputs: Mapping[str, Any],
        shot: dict[str, Any],
    ) -> Clip:
        """An edit with a plate and a matte."""
        known = ("track", "plane", "pad", "pixel_centers", "codec", "quality", "progress")
        unknown = sorted(set(shot) - set(known))
        if unknown:
            raise TypeError(f"{operation.split()[-1]}() has no option {', '.join(unknown)}")
        given: dict[str, Any] = {**fields, "plate": "@plate", "matte": _path(matte)}
        with _track_file(shot.get("track"), given):
            all_params = {
                **params,
                "shot": without_none({name: shot.get(name) for name in ("pad", "plane", "pixel_centers")}) or None,
                "encoding": _encoding(shot.get("codec"), shot.get("quality"), None),
            }
            inputs = {**inputs, "@plate": as_array(plate)}
            return self._to(target, operation, given, all_params, inputs, shot.get("progress"))

    def __repr__(self) -> str:
        return f"Clip({self.path!r})"


def _path(clip: Clip | PathLike | None) -> str | None:
    return clip.path if isinstance(clip, Clip) else None if clip is None else os.fspath(clip)


def _encoding(codec: str | None, quality: int | None, lossless: bool | None) -> dict[str, Any] | None:
    return without_none({"codec": codec, "video_quality": quality, "lossless": lossless}) or None


class _track_file:
    """Puts the file of a track into the fields of an operation."""

    def __init__(self, track: TrackLike, fields: dict[str, Any]) -> None:
        self._track, self._fields = track, fields
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def __enter__(self) -> None:
        if isinstance(self._track, Track):
            self._folder = tempfile.TemporaryDirectory(prefix="ravec-")
            path = os.path.join(self._folder.name, "track.json")
            self._track.save(path)
            self._fields["track"] = path
        elif self._track is not None:
            self._fields["track"] = os.fspath(self._track)

    def __exit__(self, *_: object) -> None:
        if self._folder is not None:
            self._folder.cleanup()

"""Triangle meshes: checks, distances, simplification, offsets and Booleans."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, Literal, TypeAlias, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _ravec
from ._options import PathLike, Picture, Progress, operate, picture, report_of, text

#: A length in units of the mesh, or as in ``"0.1%"`` of the diagonal or ``"2mm"``.
Length: TypeAlias = Union[float, str]


class Mesh:
    """A mesh of triangles.

    :param vertices: coordinates of shape (V, 3)
    :param faces: vertices of the triangles of shape (F, 3), counterclockwise seen from outside
    """

    def __init__(self, vertices: ArrayLike, faces: ArrayLike) -> None:
        points = np.ascontiguousarray(vertices, dtype=np.float64)
        triangles = np.asarray(faces)
        if triangles.size == 0:
            triangles = triangles.reshape(0, 3).astype(np.uint32)
        if points.ndim != 2 or triangles.ndim != 2:
            raise ValueError(
                f"vertices and faces have the shape (N, 3), not {points.shape} and {triangles.shape}"
            )
        if triangles.dtype.kind not in "iu":
            raise ValueError(f"faces are whole numbers, not {triangles.dtype}")
        if triangles.size and (triangles.min() < 0 or triangles.max() > np.iinfo(np.uint32).max):
            raise ValueError("faces are numbers of vertices, from 0")
        self._data = _ravec.MeshData(points, np.ascontiguousarray(triangles, dtype=np.uint32))
        self._report: dict[str, Any] = {}
        self._arrays: tuple[NDArray[np.float64], NDArray[np.uint32]] | None = None

    @classmethod
    def _of(cls, data: _ravec.MeshData, report: dict[str, Any]) -> Mesh:
        mesh = cls.__new__(cls)
        mesh._data, mesh._report, mesh._arrays = data, report, None
        return mesh

    @staticmethod
    def _is_like(value: Any) -> bool:
        return isinstance(value, Mesh) or (hasattr(value, "vertices") and hasattr(value, "faces"))

    @classmethod
    def _from(cls, value: MeshLike) -> Mesh:
        if isinstance(value, Mesh):
            return value
        if isinstance(value, (str, os.PathLike)):
            return cls.load(value)
        if cls._is_like(value):
            return cls(value.vertices, value.faces)
        vertices, faces = value
        return cls(vertices, faces)

    @classmethod
    def load(cls, path: PathLike, *, progress: Progress = None) -> Mesh:
        """Reads STL, PLY, OBJ, OFF, 3MF or glTF."""
        fields = {"input": os.fspath(path), "output": "@output"}
        outcome = operate("mesh convert", fields, progress=progress)
        return cls._of(outcome.mesh("@output"), report_of(outcome))

    def save(
        self,
        path: PathLike,
        *,
        ascii: bool = False,
        precision: Literal["exact", "single"] = "exact",
        progress: Progress = None,
    ) -> dict[str, Any]:
        """Writes a file whose extension selects the format, whole or not at all. Returns the report."""
        outcome = operate(
            "mesh convert",
            {"input": "@input", "output": os.fspath(path)},
            params={"output": {"ascii": ascii, "precision": precision}},
            inputs={"@input": self._data},
            progress=progress,
        )
        return report_of(outcome)

    @property
    def vertices(self) -> NDArray[np.float64]:
        """Coordinates of shape (V, 3), which are not to be changed."""
        return self._kept()[0]

    @property
    def faces(self) -> NDArray[np.uint32]:
        """Vertices of the triangles of shape (F, 3), which are not to be changed."""
        return self._kept()[1]

    def _kept(self) -> tuple[NDArray[np.float64], NDArray[np.uint32]]:
        if self._arrays is None:
            self._arrays = (self._data.vertices(), self._data.faces())
            for array in self._arrays:
                array.setflags(write=False)
        return self._arrays

    @property
    def report(self) -> dict[str, Any]:
        """The report of the operation that made the mesh; empty for one that was made of arrays."""
        return self._report

    @property
    def bounds(self) -> NDArray[np.float64] | None:
        """Corners of the bounding box, of shape (2, 3); ``None`` without triangles."""
        bounds = self._data.bounds()
        return None if bounds is None else np.array(bounds)

    def to_trimesh(self) -> Any:
        """The mesh as one of trimesh, with the same vertices and faces."""
        import trimesh

        return trimesh.Trimesh(self.vertices.copy(), self.faces.astype(np.int64), process=False)

    def _report_of(
        self,
        operation: str,
        params: Mapping[str, Any],
        progress: Progress,
        other: Mesh | None = None,
    ) -> dict[str, Any]:
        names = ("input",) if other is None else ("a", "b")
        fields = {name: f"@{name}" for name in names}
        inputs = dict(zip(fields.values(), [self._data] + ([] if other is None else [other._data])))
        return report_of(operate(operation, fields, params=params, inputs=inputs, progress=progress))

    def _mesh_of(self, operation: str, params: Mapping[str, Any], progress: Progress) -> Mesh:
        fields = {"input": "@input", "output": "@output"}
        inputs = {"@input": self._data}
        outcome = operate(operation, fields, params=params, inputs=inputs, progress=progress)
        return Mesh._of(outcome.mesh("@output"), report_of(outcome))

    def info(self, *, progress: Progress = None) -> dict[str, Any]:
        """Figures: area, volume, borders, components and more."""
        figures: dict[str, Any] = self._report_of("mesh info", {}, progress)["figures"]
        return figures

    def check(
        self,
        *,
        no_intersections: bool | None = None,
        open: bool | None = None,
        list: int | None = None,
        weld: Length | None = None,
        progress: Progress = None,
    ) -> dict[str, Any]:
        """Looks for defects: ``passed``, and ``findings`` with the places of each kind.

        :param no_intersections: do not search for self-intersections
        :param open: let the surface have borders
        :param list: maximum number of places of each kind
        :param weld: make vertices one first that are no farther apart than this
        """
        params = {
            "no_intersections": no_intersections,
            "open": open,
            "list": list,
            "weld": text(weld),
        }
        return self._report_of("mesh check", params, progress)

    def weld(self, distance: Length = 0, *, progress: Progress = None) -> Mesh:
        """The mesh with vertices made one that are no farther apart than ``distance``; 0 welds equal places."""
        return self._mesh_of("mesh convert", {"weld": text(distance)}, progress)

    def simplify(
        self,
        *,
        triangles: int | None = None,
        error: Length | None = None,
        feature_angle: float | None = None,
        lock_boundary: bool | None = None,
        allow_intersections: bool | None = None,
        max_turn: float | None = None,
        min_quality: float | None = None,
        weld: Length | None = None,
        progress: Progress = None,
    ) -> Mesh:
        """The mesh with fewer triangles.

        :param triangles: stop when there are no more than this
        :param error: largest distance between the surfaces, both ways
        :param feature_angle: edges that are kept have normals that differ by more than this, in degrees
        :param lock_boundary: leave borders exactly as they are
        :param allow_intersections: let triangles meet that did not
        """
        params = {
            "triangles": triangles,
            "error": text(error),
            "feature_angle": feature_angle,
            "lock_boundary": lock_boundary,
            "allow_intersections": allow_intersections,
            "max_turn": max_turn,
            "min_quality": min_quality,
            "weld": text(weld),
        }
        return self._mesh_of("mesh simplify", params, progress)

    def distance(
        self,
        other: MeshLike,
        *,
        tolerance: Length | None = None,
        samples: int | None = None,
        within: Length | None = None,
        progress: Progress = None,
    ) -> dict[str, Any]:
        """Distances between two surfaces, with bounds that are proved.

        :param tolerance: largest difference between the bounds
        :param samples: places on each surface for mean and root mean square
        :param within: ``passed`` says whether no place is farther than this from the other surface
        """
        params = {"tolerance": text(tolerance), "samples": samples, "within": text(within)}
        return self._report_of("mesh compare", params, progress, Mesh._from(other))

    def render(
        self,
        *,
        width: int = 800,
        height: int = 600,
        view: str | None = None,
        up: Literal["y", "z"] | None = None,
        perspective: float | None = None,
        zoom: float | None = None,
        edges: bool | None = None,
        section: str | None = None,
        transparent: bool | None = None,
        samples: int | None = None,
        compare: MeshLike | None = None,
        progress: Progress = None,
    ) -> Picture:
        """A picture of the mesh.

        :param view: front, right, back, left, top, bottom, iso, or degrees around and up, as in ``"30,20"``
        :param up: the axis that points upward
        :param perspective: field of view in degrees; without it parallel lines stay parallel
        :param edges: draw the edges of all triangles
        :param section: cut the mesh open, as in ``"x=2.5"`` or ``"-y=40%"``
        :param compare: color each place by its distance to this mesh
        """
        fields = {"input": "@input", "output": "@output"}
        inputs = {"@input": self._data}
        if compare is not None:
            fields["compare"], inputs["@compare"] = "@compare", Mesh._from(compare)._data
        outcome = operate(
            "mesh render",
            fields,
            params={
                "width": width,
                "height": height,
                "view": view,
                "up": up,
                "perspective": perspective,
                "zoom": zoom,
                "edges": edges,
                "section": section,
                "transparent": transparent,
                "samples": samples,
            },
            inputs=inputs,
            progress=progress,
        )
        return picture(outcome.picture("@output"))

    def offset(self, distance: Length, **options: Any) -> Mesh:
        """The surface at a distance; see :func:`offset`."""
        return offset(self, distance, **options)

    def __or__(self, other: MeshLike) -> Mesh:
        return boolean("a | b", a=self, b=other)

    def __and__(self, other: MeshLike) -> Mesh:
        return boolean("a & b", a=self, b=other)

    def __sub__(self, other: MeshLike) -> Mesh:
        return boolean("a - b", a=self, b=other)

    def __xor__(self, other: MeshLike) -> Mesh:
        return boolean("a ^ b", a=self, b=other)

    def __repr__(self) -> str:
        vertices, triangles = self._data.counts()
        return f"<ravec.Mesh of {vertices} vertices and {triangles} triangles>"

    def _repr_png_(self) -> bytes | None:
        if self._data.counts()[1] == 0:
            return None
        return self.render(width=480, height=360)._repr_png_()


#: A mesh, one of trimesh, a pair of vertices and faces, or a path.
MeshLike: TypeAlias = Any


def offset(
    mesh: MeshLike,
    distance: Length,
    *,
    tolerance: Length | None = None,
    side: Literal["both", "outer", "inner", "shell"] | None = None,
    open: Literal["refuse", "thicken"] | None = None,
    no_simplify: bool | None = None,
    max_normal_deviation: float | None = None,
    memory: str | None = None,
    progress: Progress = None,
) -> Mesh:
    """The surface at a distance from a mesh, closed, with sharp creases, within a tolerance that is proved.

    ``report["passed"]`` of the result is ``False`` if the proof is missing somewhere.

    :param distance: in units of the mesh, or as in ``"2%"`` of the diagonal; below 0 for the other side
    :param tolerance: maximum error of the distance at any point, below half of it
    :param side: all that is at the distance, the part reachable from outside, inside, or the mesh hollowed
    :param open: a mesh that is not closed is refused, or taken for a sheet that becomes thick
    :param no_simplify: keep all triangles
    :param max_normal_deviation: maximum angle between a merged triangle and the surface, in degrees
    :param memory: memory limit, such as ``"2GiB"``
    """
    outcome = operate(
        "offset",
        {"input": "@input", "output": "@output"},
        params={
            "distance": text(distance),
            "tolerance": text(tolerance),
            "side": side,
            "open": open,
            "no_simplify": no_simplify,
            "max_normal_deviation": max_normal_deviation,
            "memory": memory,
        },
        inputs={"@input": Mesh._from(mesh)._data},
        progress=progress,
    )
    return Mesh._of(outcome.mesh("@output"), report_of(outcome))


def boolean(
    expression: str,
    *,
    inside: Literal["positive", "nonzero", "outer-hull"] = "positive",
    close: Literal["auto", "lid", "band", "base"] = "auto",
    open: Literal["auto", "trim", "close"] = "auto",
    memory: str | None = None,
    progress: Progress = None,
    **meshes: MeshLike,
) -> Mesh:
    """An expression over meshes, as in ``boolean("(a | b) - c", a=cube, b=ball, c=drill)``.

    ``|`` is union, ``&`` intersection, ``-`` difference, ``^`` symmetric difference; ``&`` comes before the
    others, which go from left to right. The meshes may be open, cross themselves and touch.

    :param inside: the places that each mesh stands for: winding number above one half, not 0, or not reachable
        from outside
    :param close: closing of open meshes: each hole by itself (``lid``), holes that face each other in common
        (``band``), whichever takes less area (``auto``), or walls and a flat base below a relief (``base``)
    :param open: open meshes that are trimmed instead of closed: sheets in differences and intersections with solids
        (``auto``), all (``trim``) or none (``close``); a trimmed result is open
    """
    if not meshes:
        raise ValueError("an expression has meshes: name them as in boolean('a - b', a=cube, b=ball)")
    outcome = operate(
        "boolean",
        {
            "expression": expression,
            "files": [f"{name}=@{name}" for name in meshes],
            "output": "@output",
        },
        params={"inside": inside, "close": close, "open": open, "memory": memory},
        inputs={f"@{name}": Mesh._from(mesh)._data for name, mesh in meshes.items()},
        progress=progress,
    )
    return Mesh._of(outcome.mesh("@output"), report_of(outcome))

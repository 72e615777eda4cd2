"""The hands in a Rerun recording: targets, reached paths and their distance, in space and from behind the robot."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Self, TypeAlias

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike

from recorders.messages.validation import FloatArray
from recorders.rerun_scene.track import Instants, Track
from recorders.text.wording import hand_label

HAND_COLOURS = {  # Okabe and Ito, for all kinds of colour vision; further hands have them again
    "blue": (86, 180, 233),
    "orange": (230, 159, 0),
    "green": (0, 158, 115),
    "purple": (204, 121, 167),
}
TARGET_COLOUR = (160, 160, 160)

Colour: TypeAlias = tuple[int, int, int]

_TARGET_RADIUS_M = 0.012
_TRAIL_RADIUS_M = 0.004
_PATH_RADIUS_M = 0.0015
_AXES_M = {"target": 0.05, "reached": 0.08}  # length of the axes that show how a hand is turned
_CM_PER_M = 100.0


@dataclass(frozen=True, eq=False)
class FrontalPlane:
    """The hands, and the plane in which they draw, as seen from behind the robot: its left hand on the left.

    Parameters
    ----------
    lateral, up : array_like, shape (3,)
        Unit vectors of the plane, world frame: to the robot's left, and up.
    hands : tuple of str
        Names of the hands, in the order of all arrays.
    """

    lateral: ArrayLike = (0.0, 1.0, 0.0)
    up: ArrayLike = (0.0, 0.0, 1.0)
    hands: tuple[str, ...] = ("left", "right")

    def picture_cm(self, points: FloatArray) -> FloatArray:
        """Return points [m], shape (..., 3), as a picture has them [cm], shape (..., 2): to the right, down."""
        axes = -np.stack([np.asarray(self.lateral), np.asarray(self.up)], axis=1)  # (3, 2)
        return np.asarray(points @ axes * _CM_PER_M)


def hand_colours(hands: Sequence[str]) -> dict[str, Colour]:
    """Return the colour of each hand, by its name."""
    return dict(zip(hands, cycle(HAND_COLOURS.values()), strict=False))


class HandScene:
    """Sends the hands to a recording.

    Parameters
    ----------
    recording : RecordingStream
        Where to.
    plane : FrontalPlane
        Their names, and how they are seen in the plane.
    """

    def __init__(self, recording: rr.RecordingStream, plane: FrontalPlane) -> None:
        self._recording = recording
        self._plane = plane

    def send_static(self) -> Self:
        """Send names and styles."""
        for hand, colour in hand_colours(self._plane.hands).items():
            style = rr.SeriesLines(names=[hand_label(hand)], colors=[colour], widths=[2.0])
            self._recording.log(f"error/{hand}", style, static=True)
            for name, shade, radius_m in (
                ("target", TARGET_COLOUR, _TARGET_RADIUS_M),
                ("reached", colour, _TRAIL_RADIUS_M),
            ):
                solid = rr.Points3D.from_fields(colors=[shade], radii=[radius_m])
                self._recording.log(f"hands/{hand}/{name}", solid, static=True)
                flat = rr.Points2D.from_fields(colors=[shade], radii=[radius_m * _CM_PER_M])
                self._recording.log(f"frontal/{hand}/{name}", flat, static=True)
        return self

    def send_target_paths(self, targets: FloatArray) -> None:
        """Send whole paths of the targets [m], shape (T, hands, 3), to stay."""
        self._log_paths("target_path", targets, self._grey(), static=True)

    def log_paths(self, targets: FloatArray, reached: FloatArray) -> None:
        """Send whole paths [m], shapes (T, hands, 3), of now: those of the next time take their place."""
        self._log_paths("target_path", targets, self._grey(), static=False)
        self._log_paths("reached_path", reached, hand_colours(self._plane.hands), static=False)

    def send(self, instants: Instants, track: Track) -> None:
        """Send the samples of a track, which stand at these instants."""
        index, plotted, errors_cm = instants.columns(), track.plotted, track.errors_cm
        when = Instants(instants.timeline, instants.values[plotted]).columns()
        for i, hand in enumerate(self._plane.hands):
            for name, points in (("target", track.targets[:, i]), ("reached", track.reached[:, i])):
                solid = rr.Points3D.columns(positions=points)
                self._recording.send_columns(f"hands/{hand}/{name}", index, solid)
                flat = rr.Points2D.columns(positions=self._plane.picture_cm(points))
                self._recording.send_columns(f"frontal/{hand}/{name}", index, flat)
            self._recording.send_columns(f"error/{hand}", when, rr.Scalars.columns(scalars=errors_cm[plotted, i]))
            if hand in track.orientations:
                origins = (track.targets[:, i], track.reached[:, i])
                self._send_axes(hand, index, origins, track.orientations[hand])

    def _send_axes(
        self,
        hand: str,
        index: list[rr.TimeColumn],
        points: tuple[FloatArray, FloatArray],
        turned: tuple[FloatArray, FloatArray],
    ) -> None:
        """Send the axes of a hand's target, and of the hand as reached: positions (T, 3), quaternions (T, 4)."""
        for name, origins, quaternions in zip(_AXES_M, points, turned, strict=True):
            entity = f"hands/{hand}/{name}_axes"
            self._recording.log(entity, rr.TransformAxes3D(_AXES_M[name]), static=True)
            poses = rr.Transform3D.columns(translation=origins, quaternion=quaternions)
            self._recording.send_columns(entity, index, poses)

    def _grey(self) -> dict[str, Colour]:
        return dict.fromkeys(self._plane.hands, TARGET_COLOUR)

    def _log_paths(self, name: str, points: FloatArray, colours: Mapping[str, Colour], *, static: bool) -> None:
        for i, (hand, colour) in enumerate(colours.items()):
            path = points[:, i]
            solid = rr.LineStrips3D([path], colors=[colour], radii=[_PATH_RADIUS_M])
            self._recording.log(f"hands/{hand}/{name}", solid, static=static)
            flat = rr.LineStrips2D([self._plane.picture_cm(path)], colors=[colour], radii=[_PATH_RADIUS_M * _CM_PER_M])
            self._recording.log(f"frontal/{hand}/{name}", flat, static=static)

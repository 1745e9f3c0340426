#!/bin/sh
# nvidia-ncore 19.8.3: with a rolling shutter, the ray of a pixel misses the point that was projected onto it, if the
# camera is away from the world's origin.
#
# Behaviour: a camera turns on the spot by 5.7 degrees during a frame. A point is projected with the camera's poses at
# the start and the end (world_points_to_image_points_shutter_pose), and a ray is cast back through that pixel with the
# inverse poses (image_points_to_world_rays_shutter_pose). At the origin, the ray meets the point. 100 m away, the pixel
# is 12 px off to the side, and the ray misses the point, 5 m away, by 12.5 cm.
# One would guess otherwise because both functions take the same two poses of one camera, and because the origin of the
# world means nothing. But the former interpolates the translations from the world to the camera, the latter those from
# the camera to the world: while the camera turns, the first is not at rest, on a path as long as the origin is far.
# Whom it hurts: who projects points or renders with poses in a map's coordinates (UTM, a georeferenced survey): poses
# must be moved to the origin first.
set -e
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check nvidia-ncore==19.8.3 torch==2.13.0 numpy==2.4.6
"$work/venv/bin/python" > "$work/seen.txt" <<'PYTHON'
import numpy as np
import torch
from ncore.data import OpenCVPinholeCameraModelParameters, ShutterType
from ncore.sensors import CameraModel

parameters = OpenCVPinholeCameraModelParameters(
    resolution=np.array([640, 480], np.uint64),
    shutter_type=ShutterType.ROLLING_TOP_TO_BOTTOM,
    external_distortion_parameters=None,
    principal_point=np.array([320, 240], np.float32),
    focal_length=np.array([500, 500], np.float32),
    radial_coeffs=np.zeros(6, np.float32),
    tangential_coeffs=np.zeros(2, np.float32),
    thin_prism_coeffs=np.zeros(4, np.float32),
)
lens = CameraModel.from_parameters(parameters, device="cpu", dtype=torch.float64)


def camera_to_world(angle, place):
    pose = np.eye(4)
    pose[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    pose[:3, 3] = place
    return pose


for away in (0, 10, 100):
    place = np.array([away, 0.0, 0.0])
    start, end = (camera_to_world(angle, place) for angle in (-0.05, 0.05))
    point = place + [0.3, 0.01, 5.0]
    found = lens.world_points_to_image_points_shutter_pose(point[None], np.linalg.inv(start), np.linalg.inv(end))
    ray = lens.image_points_to_world_rays_shutter_pose(found.image_points, start, end).world_rays[0].numpy()
    miss = np.linalg.norm(np.cross(point - ray[:3], ray[3:])) / np.linalg.norm(ray[3:])
    print(f"{away} m from the origin: column {found.image_points[0, 0]:.1f}, the ray misses by {100 * miss:.1f} cm")
PYTHON
sed -n 's/^#> //p' "$0" | diff - "$work/seen.txt"
cat "$work/seen.txt"

# Output seen (on a change, diff shows it and the script ends with 1):
#> 0 m from the origin: column 349.9, the ray misses by 0.0 cm
#> 10 m from the origin: column 351.2, the ray misses by 1.2 cm
#> 100 m from the origin: column 362.4, the ray misses by 12.5 cm

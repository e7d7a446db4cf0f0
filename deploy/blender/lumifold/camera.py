"""Cameras of Blender in glTF, and the lens of the program's options."""

import math

SENSOR_HALF_HEIGHT = 0.012  # metres; glTF has no sensor, the program takes one 24 mm high


def is_supported(camera):
    """Whether glTF has this kind of camera; it has no panoramic ones, and none that are shaders."""
    return camera.type in ("PERSP", "ORTHO")


def gltf_camera(projection):
    """The camera of glTF for a projection matrix of Blender; glTF has neither shift nor the aspect of
    pixels."""
    if projection[3][3] == 1:
        made = {"xmag": 1 / projection[0][0], "ymag": 1 / projection[1][1], "znear": 0.0, "zfar": 1e6}
        return {"type": "orthographic", "orthographic": made}
    made = {
        "yfov": 2 * math.atan(1 / projection[1][1]), "aspectRatio": projection[1][1] / projection[0][0],
        "znear": 1e-3
    }
    return {"type": "perspective", "perspective": made}


def lens(camera, matrix, yfov):
    """(f-stop, focus in metres) for the program, or (0, 0) for a pinhole. In Blender the lens has its own
    focal length, for the program that of a sensor 24 mm high: both have the same radius."""
    if not camera.dof.use_dof or camera.type != "PERSP":
        return 0.0, 0.0
    radius = camera.lens * 1e-3 / (2 * camera.dof.aperture_fstop)
    return SENSOR_HALF_HEIGHT / math.tan(yfov / 2) / (2 * radius), focus(camera, matrix)


def focus(camera, matrix):
    """Distance of the plane of focus along the view axis."""
    thing = camera.dof.focus_object
    if thing is None:
        return camera.dof.focus_distance
    axis = [matrix[row][2] for row in range(3)]
    away = [matrix[row][3] - thing.matrix_world[row][3] for row in range(3)]
    length = math.sqrt(sum(part * part for part in axis))
    return max(sum(a * b for a, b in zip(axis, away)) / length, 1e-3)

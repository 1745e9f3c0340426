#!/usr/bin/env python3
"""GIMP 3 plug-in: Filters > Distorts > Undo rolling shutter, by the command `unshutter`.

The straightened picture becomes a new layer at the top; the layers below and the file are not changed. If the photo is
left unchanged, no layer is added, and a message says why.
"""

import os
import shutil
import subprocess
import sys
import tempfile

import gi

gi.require_version("Gimp", "3.0")
from gi.repository import Gimp, Gio, GLib  # noqa: E402 (its version has to be chosen before)

PROCEDURE = "plug-in-unshutter"
COMMAND = os.environ.get("UNSHUTTER", "unshutter")  # its place, where that is not on the PATH


class UnshutterPlugIn(Gimp.PlugIn):
    """Adds a layer with the photo as a global shutter would have taken it."""

    def do_set_i18n(self, _name):
        """Tells GIMP that there are no translations."""
        return False

    def do_query_procedures(self):
        """Names the procedures of this plug-in."""
        return [PROCEDURE]

    def do_create_procedure(self, name):
        """Describes the procedure, and its place in the menu."""
        procedure = Gimp.ImageProcedure.new(self, name, Gimp.PDBProcType.PLUGIN, straighten, None)
        procedure.set_image_types("RGB*, GRAY*")
        procedure.set_sensitivity_mask(Gimp.ProcedureSensitivityMask.ALWAYS)
        procedure.set_menu_label("Undo _rolling shutter")
        procedure.add_menu_path("<Image>/Filters/Distorts")
        procedure.set_documentation("Undo rolling-shutter distortion of a photo", __doc__, name)
        procedure.set_attribution("The unshutter developers", "Apache-2.0", "2026")
        return procedure


def straighten(procedure, _run_mode, image, _drawables, _config, _data):
    """Runs the command on a copy of what the image shows, and adds its result as a layer."""
    with tempfile.TemporaryDirectory(prefix="unshutter-") as folder:
        photo = os.path.join(folder, "photo.png")
        result = os.path.join(folder, "straight.png")
        copy = image.duplicate()
        try:
            copy.flatten()
            Gimp.file_save(Gimp.RunMode.NONINTERACTIVE, copy, Gio.File.new_for_path(photo), None)
        finally:
            copy.delete()
        Gimp.progress_init("Undoing the rolling shutter")
        succeeded, line = run_command(photo, result)
        if not succeeded:
            return procedure.new_return_values(Gimp.PDBStatusType.EXECUTION_ERROR, GLib.Error(line))
        Gimp.message(line)
        if "left unchanged" not in line:
            add_layer(image, result)
    return procedure.new_return_values(Gimp.PDBStatusType.SUCCESS, GLib.Error())


def run_command(photo, result):
    """Straightens a file; returns whether that succeeded, and the line that the command printed."""
    program = shutil.which(COMMAND)
    if program is None:
        return False, f"The command {COMMAND} was not found: install unshutter, or name its place in UNSHUTTER."
    # the result lies exactly above the photo: empty corners are filled, the size is kept
    words = [program, "rectify", photo, "-o", result, "--edges", "fill"]
    quiet = {"creationflags": subprocess.CREATE_NO_WINDOW} if sys.platform == "win32" else {}
    # GIMP's own Python and libraries are not for other programs
    outside = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=outside, **quiet)
    lines = done.stderr.strip().splitlines() or [f"{COMMAND} failed"]
    return done.returncode == 0, lines[0].replace(photo, "The photo").replace(result, "a new layer")


def add_layer(image, file):
    """Adds a picture as the top layer, in one step that can be undone."""
    image.undo_group_start()
    layer = Gimp.file_load_layer(Gimp.RunMode.NONINTERACTIVE, image, Gio.File.new_for_path(file))
    layer.set_name("straightened")
    image.insert_layer(layer, None, 0)
    image.undo_group_end()
    Gimp.displays_flush()


Gimp.main(UnshutterPlugIn.__gtype__, sys.argv)

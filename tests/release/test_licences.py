"""Which licences a release may bring with it."""

from email.message import Message
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path, PurePosixPath
from types import ModuleType, SimpleNamespace

import pytest


@pytest.fixture(scope="module")
def licences() -> ModuleType:
    spec = spec_from_file_location("licences", Path(__file__).parents[2] / ".ci" / "licences.py")
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def package(files: tuple[str, ...] = (), **fields: str) -> SimpleNamespace:
    metadata = Message()
    for name, value in fields.items():
        metadata[name.rstrip("0123456789").replace("_", "-")] = value
    return SimpleNamespace(name="some", metadata=metadata, files=[PurePosixPath(each) for each in files])


@pytest.mark.parametrize(
    ("terms", "strong"),
    [
        ("MIT", False),
        ("GPL-3.0-or-later", True),
        ("AGPL-3.0-only", True),
        ("LGPL-3.0-or-later", False),
        ("GNU Lesser General Public License v3 (LGPLv3)", False),
        ("GNU General Public License v3 (GPLv3)", True),
        ("GNU Affero General Public License v3", True),
        ("MIT OR GPL-2.0-only", False),
        ("MIT AND GPL-2.0-only", True),
        ("MIT AND GPL-3.0-or-later WITH GCC-exception-3.1", False),
    ],
)
def test_the_gpl_is_told_from_others(licences: ModuleType, terms: str, strong: bool) -> None:
    assert licences.is_strong(terms) is strong


def test_a_package_says_its_licence_in_one_of_three_ways(licences: ModuleType) -> None:
    classifiers = {"Classifier1": "License :: OSI Approved :: MIT License", "Classifier2": "Topic :: Printing"}
    assert licences.licence(package(License_Expression="MIT-0", **classifiers)) == "MIT-0"
    assert licences.licence(package(License="long text", **classifiers)) == "MIT License"
    assert licences.licence(package(License="BSD 3-Clause\nCopyright ...")) == "BSD 3-Clause"
    assert licences.licence(package()) == "?"


def test_encoders_in_wheels_are_seen(licences: ModuleType) -> None:
    files = ("av.libs/libx264-d6533a8d.so.165", "av/.dylibs/libx265.216.dylib", "av.libs/libvpx-edb6de90.so.12")
    assert licences.carried(package(files)) == ["libx264", "libx265"]

"""Builds the Debian package into dist/; see `systemd/package`.

The wheels of all libraries, for one Python and one architecture, become an environment in
/usr/lib/moar-companion: an installation needs no network, and dpkg knows each file.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from email.parser import HeaderParser
from email.utils import formatdate
from pathlib import Path

from wheels import MACHINES, PYTHONS, ROOT, pip_install, wanted

HERE = Path(__file__).resolve().parent
MAINTAINER = "moar-companion maintainers <maintainers@moar-companion.example>"
EXTRAS = {"lidar"}
"""Beside what every flight needs: the decoder of a Velodyne's packets."""
HOME = "usr/lib/moar-companion"
INSTALLED = {  # files of this folder, by their place
    "moar-companion.service": "usr/lib/systemd/system/moar-companion.service",
    "sysusers.conf": "usr/lib/sysusers.d/moar-companion.conf",
    "tmpfiles.conf": "usr/lib/tmpfiles.d/moar-companion.conf",
    "serial.rules": "usr/lib/udev/rules.d/61-moar-companion.rules",
    "launcher": f"{HOME}/bin/moar-companion",
    "in-flight": f"{HOME}/bin/in-flight",
    "deb/copyright": "usr/share/doc/moar-companion/copyright",
    "deb/lintian-overrides": "usr/share/lintian/overrides/moar-companion",
}
CONFIGURATION = ("companion.yaml", "schemas", "sites", "vehicles")
"""Of configs/: dpkg's conffiles, which an upgrade leaves as they were changed."""


def main() -> None:
    """Build one package; its path is printed."""
    parser = argparse.ArgumentParser(prog="systemd/package", description=__doc__.splitlines()[0])
    here = {machine: name for name, machine in MACHINES.items()}.get(platform.machine())
    parser.add_argument("--arch", choices=sorted(MACHINES), default=here, required=here is None)
    parser.add_argument(
        "--python",
        choices=PYTHONS,
        default=_system_python(),
        help="of the system that it is for: 3.10 JetPack 6 and Ubuntu 22.04, 3.11 Debian 12, "
        "3.12 Ubuntu 24.04, 3.13 Debian 13 (default: %(default)s, of this computer)",
    )
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="default: dist")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="moar-package-") as scratch:
        print(build(options.arch, options.python, options.out.resolve(), Path(scratch)))


def build(architecture: str, python: str, out: Path, scratch: Path) -> Path:
    """Builds a package; returns its path."""
    root = scratch / "root"
    packages = root / HOME / "lib" / f"python{python}" / "site-packages"
    wheel = _program(scratch)
    install = pip_install(python, architecture, packages)
    subprocess.run([*install, *wanted(python, architecture, EXTRAS), wheel], check=True)
    shutil.rmtree(packages / "bin", ignore_errors=True)
    _lay_out(root, python)
    version = f"{_version(wheel)}+py{python}"
    _documents(root, version)
    _control(root, architecture, python, version)
    out.mkdir(parents=True, exist_ok=True)
    package = out / f"moar-companion_{version}_{architecture}.deb"
    subprocess.run(
        ["dpkg-deb", "--root-owner-group", "-Zxz", "-z1", "--build", root, package],
        stdout=subprocess.DEVNULL,
        env={**os.environ, "SOURCE_DATE_EPOCH": str(_changed_s())},
        check=True,
    )
    return package


def _program(scratch: Path) -> Path:
    """The wheel of the program itself."""
    shutil.rmtree(ROOT / "build", ignore_errors=True)  # modules that are no more would be taken
    command = [sys.executable, "-m", "pip", "-qq", "wheel", "--no-deps", "--wheel-dir", scratch]
    subprocess.run(
        [*command, "--build-constraint", ROOT / "constraints.txt", ROOT], check=True, cwd=ROOT
    )
    (wheel,) = scratch.glob("moar_companion-*.whl")
    return wheel


def _lay_out(root: Path, python: str) -> None:
    """Puts everything but the libraries and the control files into its place."""
    for name, place in INSTALLED.items():
        target = root / place
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(HERE / name, target)
    unit = root / INSTALLED["moar-companion.service"]
    shutil.copyfile(unit, unit.with_name("moar-companion@.service"))
    (root / HOME / "bin/python").symlink_to(f"../../../bin/python{python}")
    (root / HOME / "pyvenv.cfg").write_text(
        f"home = /usr/bin\ninclude-system-site-packages = false\nversion = {python}\n"
    )
    (root / "usr/bin").mkdir()
    (root / "usr/bin/moar-companion").symlink_to("../lib/moar-companion/bin/moar-companion")
    for name in CONFIGURATION:
        source, target = ROOT / "configs" / name, root / "etc/moar-companion" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        (shutil.copytree if source.is_dir() else shutil.copyfile)(source, target)
    # What a person may write is not what all may: dpkg takes the modes from here.
    for path in root.rglob("*"):
        if not path.is_symlink():
            path.chmod(0o755 if path.is_dir() or path.parent.name == "bin" else 0o644)


def _documents(root: Path, version: str) -> None:
    """The guides, and both lists of changes."""
    folder = root / "usr/share/doc/moar-companion"
    (packages,) = (root / HOME / "lib").glob("python*/site-packages")
    place = packages.relative_to(root / "usr") / "moar_companion/configs"
    (folder / "configs").symlink_to(Path("../../..") / place)
    for name, text in {
        "changelog.gz": (ROOT / ".github/CHANGELOG.md").read_text(),
        "changelog.Debian.gz": f"moar-companion ({version}) unstable; urgency=medium\n\n"
        f"  * See changelog.gz.\n\n -- {MAINTAINER}  {formatdate(_changed_s())}\n",
    }.items():
        (folder / name).write_bytes(gzip.compress(text.encode(), 9, mtime=0))
        (folder / name).chmod(0o644)


def _control(root: Path, architecture: str, python: str, version: str) -> None:
    """The control files; to be called when all others are there."""
    files = sorted(path for path in root.rglob("*") if path.is_file() and not path.is_symlink())
    control = root / "DEBIAN"
    control.mkdir()
    size_kib = sum(path.stat().st_size for path in files) // 1024
    (control / "control").write_text(
        f"""\
Package: moar-companion
Version: {version}
Architecture: {architecture}
Maintainer: {MAINTAINER}
Installed-Size: {size_kib}
Depends: python{python}, libc6 (>= 2.35), libgcc-s1, libstdc++6, systemd
Recommends: ca-certificates, udev
Section: science
Priority: optional
Description: companion computer of a drone that inspects power lines
 Plans risk-aware paths next to a power line and flies them with a PX4 or
 ArduPilot autopilot, over MAVLink. The pilot has precedence at all times.
"""
    )
    names = {path: path.relative_to(root).as_posix() for path in files}
    (control / "conffiles").write_text(
        "".join(f"/{name}\n" for name in names.values() if name.startswith("etc/"))
    )
    (control / "md5sums").write_text(
        "".join(
            f"{hashlib.md5(path.read_bytes()).hexdigest()}  {name}\n"  # noqa: S324 - dpkg's
            for path, name in names.items()
            if not name.startswith("etc/")
        )
    )
    for name in ("postinst", "prerm", "postrm"):
        shutil.copy(HERE / "deb" / name, control / name)
        (control / name).chmod(0o755)


def _version(wheel: Path) -> str:
    """The version of a wheel as Debian orders it: 1.0rc1 and 1.0.dev3 before 1.0."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (each for each in archive.namelist() if each.endswith(".dist-info/METADATA"))
        version = str(HeaderParser().parsestr(archive.read(name).decode())["Version"])
    for mark in (".dev", "rc", "a", "b"):
        public, plus, local = version.partition("+")
        version = f"{public.replace(mark, f'~{mark.lstrip(chr(46))}')}{plus}{local}"
    return version


def _changed_s() -> int:
    """Time of the last commit, in seconds since 1970; of sources without git, of CHANGELOG.md."""
    done = subprocess.run(
        ["git", "-C", ROOT, "log", "-1", "--format=%ct"],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode == 0:
        return int(done.stdout)
    return int((ROOT / ".github/CHANGELOG.md").stat().st_mtime)


def _system_python() -> str:
    """Version of the system's own Python, which the package will run on."""
    done = subprocess.run(
        ["/usr/bin/python3", "-c", "import sys; print('%d.%d' % sys.version_info[:2])"],
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stdout.strip() or "3.11"


if __name__ == "__main__":
    main()

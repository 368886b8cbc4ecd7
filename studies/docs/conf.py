"""The site's settings: python -m sphinx -W --keep-going studies/docs OUT.

With OPTID_DOCS=quick the gallery's examples and the atlas's figures are left out, which .ci/full makes; all pages are
built, and the notebooks are executed.
"""

import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))

import optid  # noqa: E402

QUICK = os.environ.get("OPTID_DOCS") == "quick"

project, author, copyright = "optid", "the optid authors", "the optid authors"
version = release = optid.__version__
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
    "studies.docs.extension",
]
exclude_patterns = [
    "extension",
    "gallery",
    "generated/gallery/*.ipynb",
    "generated/gallery/*.py",
    "**/README.md",
]
source_suffix = {".rst": "restructuredtext", ".md": "myst-nb", ".ipynb": "myst-nb"}

html_theme, html_title = "furo", f"optid {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
optid_quick = QUICK

# Only the notebooks have cells to execute; a cell that raises fails the build.
nb_execution_mode, nb_execution_timeout, nb_execution_raise_on_error = "force", 300, True
nb_execution_in_temp = True
nb_merge_streams = True

autodoc_typehints, autodoc_member_order = "none", "bysource"
napoleon_use_ivar = True
napoleon_numpy_docstring = napoleon_google_docstring = True

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "generated/gallery",
    "filename_pattern": r"[\\/]plot_",
    "plot_gallery": not QUICK,
    "abort_on_example_error": True,
    "show_memory": False,
    "min_reported_time": 1e9,
    "download_all_examples": False,
    "write_computation_times": False,
    "within_subsection_order": "FileNameSortKey",
}
suppress_warnings = ["config.cache"]

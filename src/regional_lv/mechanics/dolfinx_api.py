"""Every call whose form depends on the dolfinx version, and nothing else.

Debian 12 ships dolfinx 0.5.2; the wheel `dolfinx-solver-real` brings 0.11, which `make test-wheel`
runs. The rest of the package asks for what it needs in its own words and never imports dolfinx
itself.
"""

import contextlib
import fcntl
import gc
import logging
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

# Every process simulates alone. By this variable Open MPI would take one that SLURM's srun started
# for a part of an MPI job, and end it unless it was built for that SLURM.
os.environ.pop("SLURM_NODELIST", None)
# Nor does it need the daemon that Open MPI would start for it, which takes 0.2 s.
os.environ["OMPI_MCA_ess_singleton_isolated"] = "1"

# The wheel wants to be first: it loads the MPI that all of its parts share.
with contextlib.suppress(ModuleNotFoundError):
    import dolfinx_solver  # noqa: F401

# Before dolfinx and PETSc: where their HDF5 is another version than h5py's and comes first, a
# process that simulates cannot write posteriors.
with contextlib.suppress(ImportError):
    import h5py  # noqa: F401

import cffi
import dolfinx
import numpy as np
import ufl
from dolfinx import cpp, fem
from mpi4py import MPI
from petsc4py import PETSc

from regional_lv.errors import InputError
from regional_lv.input_files import reason_of

log = logging.getLogger(__name__)

VERSION = tuple(int(part) for part in dolfinx.__version__.split(".")[:2])
_LEGACY = VERSION < (0, 8)

FLAGS = ["-O3"]
CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "regional_lv"


def _c_compiler() -> list[str]:
    """Command of the C compiler: $CC, the machine's own, or else the one in the wheel `ziglang`.

    Raises InputError if there is none.
    """
    if given := os.environ.get("CC"):
        with contextlib.suppress(ValueError, IndexError):  # quotes without end, blanks alone
            command = shlex.split(given)
            if shutil.which(command[0]):
                return command
        raise InputError(f"CC={given}: there is no such C compiler; correct CC, or unset it")
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return [name]
    if find_spec("ziglang"):
        return [sys.executable, "-P", "-m", "ziglang", "cc"]
    raise InputError(
        "no C compiler was found, and the forms of the finite element model are compiled; install "
        "gcc, or `pip install ziglang` into the environment, or set CC"
    )


def _shared_library(_comm, form, form_compiler_options=None, jit_options=None):
    """Compile a form as `dolfinx.jit.ffcx_jit` does, but into a plain shared library.

    dolfinx makes an extension module of it, and so needs Python's C headers, which few machines
    have.
    """
    from ffcx import get_options, naming
    from ffcx.codegeneration import get_include_path
    from ffcx.codegeneration import jit as declarations
    from ffcx.compiler import compile_ufl_objects

    options = get_options(form_compiler_options)
    command, flags = _c_compiler(), ["-std=c17", "-fPIC", "-shared", *FLAGS]
    key = str((sorted(options.items()), command[-2:], flags))
    module = f"libffcx_forms_{naming.compute_signature([form], key)}"
    name = naming.form_name(form, 0, module)
    source = CACHE / f"{module}.c"
    library, ready = source.with_suffix(".so"), source.with_suffix(".c.cached")
    if not ready.exists():
        (_, code), _ = compile_ufl_objects([form], namespace=module, options=options)
        source.write_text(code)
        made = [*command, *flags, "-I", get_include_path(), source, "-o", library, "-lm"]
        done = subprocess.run(made, capture_output=True, text=True)
        if done.returncode:
            raise cffi.VerificationError(f"{source}:\n{done.stderr}")
        ready.touch()
    ffi = cffi.FFI()
    ffi.cdef(
        declarations.UFC_HEADER_DECL.format("float64")
        + declarations.UFC_INTEGRAL_DECL
        + declarations.UFC_FORM_DECL
        + f"extern ufcx_form {name};"
    )
    loaded = ffi.dlopen(str(library))
    return getattr(loaded, name), SimpleNamespace(ffi=ffi, lib=loaded), (None, None)


if "dolfinx_solver" in sys.modules:
    dolfinx.jit.ffcx_jit = _shared_library


def _compiled(make, *arguments):
    """What `make` makes of `arguments`, a form or a function space, both with code in C.

    The C compiler runs once per form and its result is kept in a cache on disk: -O3 costs a few
    seconds there and pays in every Newton step. ffcx gives a form that another process compiles
    ten seconds, and one whose process was killed can never be compiled again. So one process at a
    time compiles here, and takes away what others left unfinished.
    """
    CACHE.mkdir(parents=True, exist_ok=True)
    options = {"cffi_extra_compile_args": FLAGS, "cache_dir": str(CACHE)}
    with open(CACHE / "lock", "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            # Seconds, unless that one was suspended, or a file server lost its locks.
            log.info("waiting for another process that compiles; it holds %s", lock.name)
            fcntl.flock(lock, fcntl.LOCK_EX)
        except OSError as error:  # compiling at the same time would damage what others compile
            raise InputError(
                f"{lock.name}: cannot be locked ({reason_of(error)}); set XDG_CACHE_HOME to a "
                "folder on a disk of this machine"
            ) from error
        for source in CACHE.glob("*.c"):
            if not source.with_suffix(".c.cached").exists():
                source.unlink()
        with tempfile.TemporaryFile() as printed:
            try:
                with _quiet(printed):
                    return make(*arguments, **{"jit_params" if _LEGACY else "jit_options": options})
            except (cffi.VerificationError, ValueError) as error:
                command = shlex.join(_c_compiler())
                if isinstance(error, ValueError):
                    raise
                printed.seek(0)
                lines = f"{error}\n{printed.read().decode(errors='replace')}".strip().splitlines()
                raise InputError(
                    f"the C compiler `{command}` failed ({lines[-1][-200:]}); correct CC, CFLAGS "
                    "and LDFLAGS, or unset them"
                ) from error


@contextlib.contextmanager
def _quiet(file) -> Iterator[None]:
    """Within it, what compilers print goes to `file`. What builds with them sets up the log of the
    whole process; after it, that is as before."""
    root, nothing = logging.getLogger(), logging.NullHandler()
    level, disabled = root.level, root.manager.disable
    before = {stream: os.dup(stream) for stream in (1, 2)}
    sys.stdout.flush()
    sys.stderr.flush()
    root.addHandler(nothing)
    logging.disable(logging.INFO)
    try:
        for stream in before:
            os.dup2(file.fileno(), stream)
        yield
    finally:
        for stream, kept in before.items():
            os.dup2(kept, stream)
            os.close(kept)
        logging.disable(disabled)
        root.removeHandler(nothing)
        root.setLevel(level)


def _function_space(mesh, element):
    """Function space; from dolfinx 0.11 on it has no code of its own to compile."""
    if _LEGACY:
        return _compiled(fem.FunctionSpace, mesh, element)
    if VERSION < (0, 11):
        return _compiled(fem.functionspace, mesh, element)
    return fem.functionspace(mesh, element)


def hexahedral_mesh(points: np.ndarray, cells: np.ndarray):
    """Mesh of 27-node or 8-node hexahedra.

    `points` (n, 3) in mm and `cells` (m, 27 or 8) in VTK order. Returns the dolfinx mesh and, for
    each of its cells, the row of `cells` that it came from.
    """
    degree = element_order(cells)
    permutation = np.asarray(cpp.io.perm_vtk(cpp.mesh.CellType.hexahedron, cells.shape[1]))
    cells = np.ascontiguousarray(cells[:, permutation], dtype=np.int64)
    points = np.ascontiguousarray(points, dtype=np.float64)
    if _LEGACY:
        # ffcx writes "equispaced" into the mesh's element when it compiles a form, and forms made
        # after that would have other names than those of a process that found all in the cache.
        nodes = ufl.FiniteElement("Lagrange", ufl.hexahedron, degree, variant="equispaced")
        domain = ufl.Mesh(ufl.VectorElement(nodes))
        mesh = dolfinx.mesh.create_mesh(MPI.COMM_SELF, cells, points, domain)
        return mesh, np.asarray(mesh.topology.original_cell_index)
    import basix.ufl

    element = basix.ufl.element("Lagrange", "hexahedron", degree, shape=(3,))
    mesh = dolfinx.mesh.create_mesh(MPI.COMM_SELF, cells=cells, x=points, e=ufl.Mesh(element))
    return mesh, np.asarray(mesh.topology.original_cell_index)


def move_nodes(mesh, points: np.ndarray) -> None:
    """Move the nodes of a mesh of `hexahedral_mesh`, in place, to `points` (n, 3) in the order of
    those that it was made from."""
    mesh.geometry.x[:] = points[np.asarray(mesh.geometry.input_global_indices)]


def element_order(cells: np.ndarray) -> int:
    """Order of hexahedra with 27 (2) or 8 (1) nodes."""
    return {27: 2, 8: 1}[cells.shape[1]]


def mixed_space(mesh, order: int = 2):
    """Displacement and pressure on hexahedra.

    Order 2: quadratic displacement and linear pressure (Taylor-Hood). Order 1: linear displacement
    and a constant pressure in each cell (Q1-P0).
    """
    family = "Lagrange" if order == 2 else "DG"
    if _LEGACY:
        cell = mesh.ufl_cell()
        displacement = ufl.VectorElement("Lagrange", cell, order)
        pressure = ufl.FiniteElement(family, cell, order - 1)
        return _function_space(mesh, ufl.MixedElement([displacement, pressure]))
    import basix.ufl

    displacement = basix.ufl.element("Lagrange", mesh.basix_cell(), order, shape=(3,))
    pressure = basix.ufl.element(family, mesh.basix_cell(), order - 1)
    element = basix.ufl.mixed_element([displacement, pressure])
    return _function_space(mesh, element)


def space(mesh, family: str, degree: int, components: int = 1):
    """Scalar or vector function space, `family` being "Lagrange" or "DG"."""
    if _LEGACY:
        return _function_space(mesh, _element(mesh, family, degree, components))
    shape = () if components == 1 else (components,)
    return _function_space(mesh, (family, degree, shape))


def _element(mesh, family, degree, components, **given):
    """Scalar or vector element of UFL's own, which dolfinx 0.5 takes."""
    kind = (family, mesh.ufl_cell(), degree)
    if components == 1:
        return ufl.FiniteElement(*kind, **given)
    return ufl.VectorElement(*kind, dim=components, **given)


def columns_space(mesh, family: str, degree: int, components: int):
    """Space of vector fields each of whose degrees of freedom is a column of a matrix."""
    # Matrices take no blocks of other widths than heights, as vector elements have them.
    if _LEGACY:
        element = ufl.FiniteElement(family, mesh.ufl_cell(), degree)
        return _function_space(mesh, ufl.MixedElement([element] * components))
    import basix.ufl

    element = basix.ufl.element(family, mesh.basix_cell(), degree)
    return _function_space(mesh, basix.ufl.mixed_element([element] * components))


def cellwise_dofs(space, components: int) -> np.ndarray:
    """Degrees of freedom (cells, components) of a `columns_space` of piecewise constants."""
    maps = [space.sub(i).dofmap for i in range(components)]
    cells = range(len(space.mesh.topology.original_cell_index))
    return np.array([[each.cell_dofs(cell)[0] for each in maps] for cell in cells])


def require_cellwise_order(mesh) -> None:
    """Raise if the degree of freedom of a piecewise constant is not the number of its cell."""
    dofmap = space(mesh, "DG", 0).dofmap
    dofs = np.array([dofmap.cell_dofs(c)[0] for c in range(len(mesh.topology.original_cell_index))])
    if not np.array_equal(dofs, np.arange(len(dofs))):
        raise RuntimeError("piecewise constants are not numbered by cell in this dolfinx")


def compile_form(form):
    """Compile a UFL form."""
    return _compiled(fem.form, form)


def facet_tags(mesh, facets: np.ndarray, tags: np.ndarray):
    """Tag facets given by the geometry nodes of their four corners.

    `facets` (k, 4) holds rows of the `points` array that the mesh was made from, in any order.
    """
    dim = mesh.topology.dim - 1
    mesh.topology.create_entities(dim)
    mesh.topology.create_connectivity(dim, dim + 1)
    if _LEGACY:
        exterior = np.asarray(cpp.mesh.exterior_facet_indices(mesh.topology))
    else:
        exterior = np.asarray(dolfinx.mesh.exterior_facet_indices(mesh.topology))
    exterior = np.sort(exterior).astype(np.int32)
    inputs = np.asarray(mesh.geometry.input_global_indices)
    nodes = inputs[_facet_corners(mesh, exterior)]
    wanted = {tuple(sorted(row)): tag for row, tag in zip(facets, tags, strict=True)}
    values = np.array([wanted.get(tuple(sorted(row)), 0) for row in nodes], dtype=np.int32)
    return dolfinx.mesh.meshtags(mesh, dim, exterior, values)


def _facet_corners(mesh, facets: np.ndarray) -> np.ndarray:
    """Geometry nodes of the four corners of exterior facets, (k, 4)."""
    # Corners of the reference hexahedron's faces, in its own order; the first eight geometry
    # nodes of a cell are its corners.
    faces = np.array(
        [(0, 1, 2, 3), (0, 1, 4, 5), (0, 2, 4, 6), (1, 3, 5, 7), (2, 3, 6, 7), (4, 5, 6, 7)]
    )
    topology = mesh.topology
    topology.create_connectivity(2, 3)
    topology.create_connectivity(3, 2)
    cell_of, faces_of = topology.connectivity(2, 3), topology.connectivity(3, 2)
    nodes_of = mesh.geometry.dofmap if VERSION < (0, 11) else mesh.geometry.dofmaps[0]
    corners = []
    for facet in facets:
        cell = cell_of.links(facet)[0]
        local = int(np.flatnonzero(faces_of.links(cell) == facet)[0])
        nodes = nodes_of.links(cell) if _LEGACY else nodes_of[cell]
        corners.append(nodes[faces[local]])
    return np.asarray(corners)


class Matrix:
    """Sparse matrix for compiled bilinear forms with the pattern of the first one, row by row:
    `indptr`, `indices` and `data`.

    dolfinx 0.5 looks for the place of each entry of each cell, which takes as long as the integrals
    themselves; here places are kept.
    """

    def __init__(self, form):
        create = fem.assemble.create_matrix if _LEGACY else fem.create_matrix
        self._made = create(form)
        self.indptr, self.indices, self.data = (
            np.asarray(each) for each in (self._made.indptr, self._made.indices, self._made.data)
        )
        self._places: dict[tuple[bytes, bytes], np.ndarray] = {}

    def assemble(self, *forms) -> None:
        """Assemble the sum of some forms, replacing what there was."""
        self.data[:] = 0.0
        for form in forms:
            if _LEGACY:
                cpp.fem.assemble_matrix(self._insert, form, [])
            else:
                fem.assemble_matrix(self._made, form)

    def _insert(self, rows: np.ndarray, columns: np.ndarray, values: np.ndarray) -> int:
        """Add what one cell or facet contributes."""
        key = rows.tobytes(), columns.tobytes()
        places = self._places.get(key)
        if places is None:
            starts, ends = self.indptr[rows], self.indptr[rows + 1]
            each = [
                first + np.searchsorted(self.indices[first:last], columns)
                for first, last in zip(starts, ends, strict=True)
            ]
            places = self._places[key] = np.concatenate(each).astype(np.int32)
        self.data[places] += values.ravel()
        return 0


def dimension(space) -> int:
    """Number of degrees of freedom of a function space."""
    return space.dofmap.index_map.size_local * space.dofmap.index_map_bs


def product(columns: np.ndarray, *forms) -> np.ndarray:
    """The matrix of the sum of compiled bilinear forms times `columns` (m, K), without making it
    where dolfinx gives what cells contribute."""
    found = np.zeros((dimension(forms[0].function_spaces[0]), columns.shape[1]))

    def add(rows: np.ndarray, at: np.ndarray, values: np.ndarray) -> int:
        found[rows] += values.reshape(len(rows), -1) @ columns[at]
        return 0

    for form in forms:
        if _LEGACY:
            cpp.fem.assemble_matrix(add, form, [])
        else:
            found += fem.assemble_matrix(form).to_scipy() @ columns
    return found


def assemble_vector(array: np.ndarray, *forms) -> np.ndarray:
    """Assemble the sum of compiled linear forms into `array`, replacing what it held."""
    array[:] = 0.0
    for form in forms:
        fem.assemble_vector(array, form)
    return array


def tabulated_dofs(subspace) -> tuple[np.ndarray, np.ndarray]:
    """Degrees of freedom of a scalar sub-space in its parent, and their coordinates (n, 3)."""
    collapsed, parent = subspace.collapse()
    # From 0.11 on there is one array for each type of cell; these meshes have one type.
    return np.asarray(parent).ravel(), collapsed.tabulate_dof_coordinates()


def solve_many(ksp, vectors: np.ndarray) -> np.ndarray:
    """Solutions (K, size) for the right-hand sides `vectors` (K, size) with a factorisation that
    has been made, all at once."""
    columns = np.asfortranarray(vectors.T)
    right = PETSc.Mat().createDense(columns.shape, array=columns, comm=PETSc.COMM_SELF)
    left = PETSc.Mat().createDense(columns.shape, comm=PETSc.COMM_SELF).setUp()
    ksp.getPC().getFactorMatrix().matSolve(right, left)
    found = left.getDenseArray().T.copy()
    for matrix in (right, left):
        matrix.destroy()
    return found


def release_unused() -> None:
    """Free the matrices and factors of simulators that are no longer referred to: PETSc keeps what
    Python drops until it is asked."""
    gc.collect()
    cleanup = getattr(PETSc, "garbage_cleanup", None)  # since 3.18
    if cleanup is not None:
        cleanup()

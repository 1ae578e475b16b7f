"""A job of the workflow: the library function that a rule names, with its files and values.

Every rule says `call="<module>:<function>"` in its `params` and names its files and values as the
function names its arguments; `workflow/scripts/call.py` hands them over. A rule that makes several
things says `calls`, a call for each name of a thing. A file or value with that name and a dot
before its own is for that call; others are for all calls that take one of their name, so that what
one call writes is what a later one reads.
"""

import gc
import importlib
import inspect
import sys
from collections.abc import Callable, Collection

from regional_lv.channels import Channels
from regional_lv.errors import InputError
from regional_lv.inputs.stiffness import from_spec
from regional_lv.study import running
from regional_lv.study.faults import explain
from regional_lv.study.layout import study_of
from regional_lv.study.progress import start_log

PACKAGE = "regional_lv"

OBJECTS = {"parameters": from_spec, "channels": Channels.parse}
"""Arguments that a rule gives as plain values, which Snakemake can compare, and what makes the
object of them."""

NOT_PASSED = {"call", "calls", "code"}
"""Names of a rule that are no arguments: what is called, and the code that it depends on."""


def function_of(call: str) -> Callable:
    """The function that `call`, such as `plots.mesh:draw`, names inside the package."""
    module, _, name = call.partition(":")
    try:
        imported = importlib.import_module(f"{PACKAGE}.{module}")
    except FileNotFoundError:
        # The first import of ArviZ on a day writes a file for the user, and one of two jobs that do
        # so at the same moment finds its temporary file gone. The file is there the second time.
        imported = importlib.import_module(f"{PACKAGE}.{module}")
    return getattr(imported, name)


def calls_of(params) -> dict[str, str]:
    """What a rule with these `params` calls, by what stands before the names of the arguments."""
    if "call" in params.keys():
        return {"": params["call"]}
    return {f"{name}.": call for name, call in params.get("calls", {}).items()}


def arguments_of(parts, before: str, taken: Collection[str]) -> dict:
    """Named files and values of a rule's `parts` for one of its calls: those with `before` before
    their names and, of those for all calls, what is `taken`; everything, if it is the only call."""
    given = {
        name: value for part in parts for name, value in part.items() if name not in NOT_PASSED
    }
    if not before:
        return given
    own = [name for name in given if name.startswith(before)]
    shared = {name: given[name] for name in given if name in taken}
    return shared | {name.removeprefix(before): given[name] for name in own}


def module_of(call: str) -> str:
    """The module of a `call`, below the package."""
    return call.partition(":")[0]


def passes_on(to: Callable) -> Callable:
    """Decorator of a function whose `**rest` are arguments of `to`: its signature says so by name,
    and rules and wildcards are checked against that."""

    def decorate(function: Callable) -> Callable:
        signature = inspect.signature(function)
        own = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        rest = inspect.signature(to).parameters.values()
        named = [p.replace(kind=p.KEYWORD_ONLY) for p in (*own, *rest)]
        changed = signature.replace(parameters=named)
        function.__signature__ = changed  # type: ignore[attr-defined]  # typeshed has none
        return function

    return decorate


def run(snakemake) -> None:
    """Run the job: log to its log file, use as many threads as it has, call its functions.

    Arguments are the named inputs, outputs and params; of the wildcards, those that the function
    takes and that have no value otherwise.

    Raises InputError in place of what a full disk, a damaged file and the like raise (`faults`).
    """
    start_log(snakemake.log[0])
    running.take_part(study_of(snakemake.log[0]))
    functions = {before: function_of(call) for before, call in calls_of(snakemake.params).items()}
    # What was imported stays. A collection, such as the one after every simulation of an effect,
    # would take a fifth of a second to look through it.
    gc.freeze()
    # Where the function's module brings torch in, it takes all cores unless it is told.
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(snakemake.threads)
    parts = snakemake.input, snakemake.output, snakemake.params
    try:
        for before, function in functions.items():
            wanted = inspect.signature(function).parameters
            values = {k: v for k, v in snakemake.wildcards.items() if k in wanted}
            values |= arguments_of(parts, before, wanted)
            function(**{k: OBJECTS[k](v) if k in OBJECTS else v for k, v in values.items()})
    except (Exception, SystemExit) as error:  # meshio ends the process over damaged files
        if fault := explain(error, snakemake.input, snakemake.output):
            raise InputError(fault) from error
        raise

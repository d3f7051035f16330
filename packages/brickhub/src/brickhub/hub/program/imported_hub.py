"""Kind of hub that a program is for."""

from brickhub.hub.program.pybricks2 import is_old_import
from brickhub.hub.program.syntax import imported_names, parse
from brickhub.hub.transport import HubProgram
from brickhub.robot import HubKind


def imported_hub(program: HubProgram) -> HubKind:
    """The kind of hub that a program imports, or that has the devices that it imports; Prime by
    default."""
    kinds = {kind.model.class_name: kind for kind in HubKind}
    kinds_by_devices: dict[str, HubKind] = {}
    # Of hubs that share a name, or a module, the first one is meant.
    for kind in HubKind:
        kinds.setdefault(kind.model.alias, kind)
        kinds_by_devices.setdefault(f"pybricks.{kind.model.devices}", kind)
    found = HubKind.PRIME
    module_sources = [module.source for module in program.modules]
    for source in (program.source, *module_sources):
        try:
            tree = parse(source)
        except (SyntaxError, ValueError):
            # The hub's compiler says what is wrong, when the program runs.
            continue
        for module, name in imported_names(tree):
            if module == "pybricks.hubs" and name in kinds:
                return kinds[name]
            found = kinds_by_devices.get(module, found)
            if is_old_import(module, name):
                found = HubKind.EV3
    return found

"""``[world]`` to a ``roadmaps.Workspace``: bounds or a map file, polygons on top of either."""

from fgplan.checks import frozen
from fgplan.io.place import Place
from fgplan.io.scenario import WorldTable
from roadmaps import Workspace, read_movingai_map, read_ros_map


def make_workspace(table: WorldTable, place: Place) -> Workspace:
    """Make the workspace of a scenario.

    Args:
        table: The checked table.
        place: Where it is, for messages and for the folder of the map file.

    Returns:
        The workspace; bounds are the map's where the scenario gives none.

    Raises:
        ScenarioError: If neither bounds nor map are given, or either is wrong.
    """
    grid = None
    if table.map is not None:
        where = place.at("map")
        path = where.path_of(table.map)
        with where.checking():
            if path.suffix == ".map":
                grid = read_movingai_map(path, cell_size_m=table.map_cell_m or 1.0)
            elif path.suffix in (".yaml", ".yml"):
                grid = read_ros_map(path)
            else:
                raise where.error(
                    f"expected a ROS map_server .yaml or a MovingAI .map file, got {table.map!r}"
                )
    if table.map_cell_m is not None and (table.map is None or not table.map.endswith(".map")):
        raise place.at("map_cell_m").error(
            "expected only with a MovingAI .map file, got it without"
        )
    if table.bounds is not None:
        lower, upper = frozen(table.bounds[0]), frozen(table.bounds[1])
    elif grid is not None:
        lower, upper = grid.bounds
    else:
        raise place.error("expected bounds or map, got neither; add bounds = [[0, 0], [10, 10]]")
    with place.checking():
        return Workspace(
            lower=lower,
            upper=upper,
            obstacles=table.obstacles,
            grid=grid,
            robot_radius_m=table.robot_radius_m,
            unknown_is_free=table.unknown == "free",
        )

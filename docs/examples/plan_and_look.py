"""Invents a region, plans across it, checks the plan with NumPy and with the verifier.

    plan_and_look.py FOLDER
"""

import pathlib
import sys

import hedgehop
import numpy as np


def main(folder: pathlib.Path) -> None:
    folder.mkdir()
    region = hedgehop.write_synthetic_region(folder)
    terrain_map = hedgehop.prepare([region.dem_file], folder / "map", osm=[region.osm_file], cell_m=60.0, crs=region.crs,
                                   label=region.label, attributions=[region.attribution])
    surface_m = terrain_map.surface_m  # a view: row 0 is the southernmost, NaN is unknown
    print(f"{np.count_nonzero(np.isfinite(surface_m))} cells, {np.nanmin(surface_m):.0f} to {np.nanmax(surface_m):.0f} m")

    request = hedgehop.Request(start=region.start, goal=region.goal, work=20000)
    plan = hedgehop.plan(terrain_map, request, progress=lambda stage, share: print(f"{stage} {share:.0%}", file=sys.stderr))
    if isinstance(plan, hedgehop.NoPlan):
        sys.exit(f"{plan.cause}: {plan.explanation}")
    plan.write(str(folder / "plan"))

    states = plan.states
    height_m = states["altitude_m"] - states["surface_m"]
    print(f"{plan.length_m / 1000:.1f} km in {plan.duration_s:.0f} s, {height_m.mean():.0f} m above the surface on average")
    verdict = hedgehop.verify(terrain_map, folder / "plan")
    print("verified" if verdict.is_verified else f"{verdict.violation_count} violations")


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]))

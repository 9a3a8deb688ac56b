"""Maps as NumPy arrays, preparation, errors."""

import gc
import math
import subprocess

import numpy as np
import pytest

import hedgehop

GRID = 40


def write_text_grid(path, void):
    """40 x 40 cells of 100 m, a slope of 2 m a cell to the east and 3 m to the north, one cell void. UTM zone 32."""
    rows = [[" ".join("-9999" if (column, row) == void else str(100 + 2 * column + 3 * row) for column in range(GRID))]
            for row in reversed(range(GRID))]
    path.write_text(f"ncols {GRID}\nnrows {GRID}\nxllcorner 600000\nyllcorner 5500000\ncellsize 100\nNODATA_value -9999\n"
                    + "\n".join(row[0] for row in rows) + "\n")


def prepare_slope(folder, **options):
    void = (20, 10)
    write_text_grid(folder / "slope.asc", void)
    return void, hedgehop.prepare([f"{folder}/slope.asc:crs=EPSG:32632"], folder / "map", cell_m=100.0, crs="EPSG:32632",
                                  settings=["void_fill_radius_m=0"], **options)


def test_layers_are_views_that_cannot_be_written(hills_map):
    for name, dtype in (("terrain_m", np.float32), ("surface_m", np.float32), ("semantics", np.uint16),
                        ("visibility_stored", np.uint16)):
        layer = getattr(hills_map, name)
        assert layer.shape == (hills_map.rows, hills_map.columns) and layer.dtype == dtype
        assert np.shares_memory(layer, getattr(hills_map, name)), "a copy was made"
        assert not layer.flags.writeable and not layer.flags.owndata
        with pytest.raises(ValueError):
            layer[0, 0] = 0


def test_a_layer_outlives_its_map(hills):
    terrain_map = hedgehop.read_map(hills[0])
    layer = terrain_map.terrain_m
    before = float(layer.sum(dtype=np.float64))
    del terrain_map
    gc.collect()
    rubbish = [np.ones(layer.shape, np.float32) for _ in range(20)]
    assert float(layer.sum(dtype=np.float64)) == before and rubbish


def test_values_stand_where_gdal_reads_them(hills, hills_map):
    generator = np.random.default_rng()
    for row, column in zip(generator.integers(0, hills_map.rows, 5), generator.integers(0, hills_map.columns, 5)):
        x_m = hills_map.west_m + (column + 0.5) * hills_map.cell_m
        y_m = hills_map.south_m + (row + 0.5) * hills_map.cell_m
        for name, file in (("terrain_m", "terrain.tif"), ("surface_m", "surface.tif"), ("semantics", "semantics.tif")):
            said = subprocess.run(["gdallocationinfo", "-valonly", "-geoloc", "-b", "1", hills[0] / file, str(x_m), str(y_m)],
                                  check=True, capture_output=True, text=True).stdout
            assert float(getattr(hills_map, name)[row, column]) == pytest.approx(float(said), abs=0.001), (row, column, name)


def test_visibility_is_a_share_with_nan_for_unknown(tmp_path):
    _, slope = prepare_slope(tmp_path)
    share, stored = slope.visibility, slope.visibility_stored
    unknown = stored == hedgehop.VISIBILITY_UNKNOWN
    assert np.array_equal(np.isnan(share), unknown)
    assert share[~unknown] == pytest.approx(stored[~unknown] / 65534.0)
    assert (~unknown).any()


def test_void_cells_are_nan_and_others_are_what_the_file_says(tmp_path):
    (column, row), slope = prepare_slope(tmp_path)
    east = round((slope.west_m - 600000) / 100)
    north = round((slope.south_m - 5500000) / 100)
    assert math.isnan(slope.terrain_m[row - north, column - east])
    assert math.isnan(slope.surface_m[row - north, column - east])
    inside = slope.terrain_m[-north:GRID - north, -east:GRID - east]
    assert inside.shape == (GRID, GRID) and np.isnan(inside).sum() == 1
    for r, c in ((30, 5), (5, 30), (35, 35)):
        assert slope.terrain_m[r - north, c - east] == pytest.approx(100 + 2 * c + 3 * r, abs=0.01)


def test_a_prepared_map_is_that_which_is_read_from_its_folder(tmp_path):
    stages = set()
    _, slope = prepare_slope(tmp_path, label="A SLOPE", progress=lambda stage, share: stages.add(stage))
    again = hedgehop.read_map(tmp_path / "map")
    assert (again.hash, again.label) == (slope.hash, "A SLOPE")
    assert np.array_equal(again.terrain_m, slope.terrain_m, equal_nan=True)
    assert stages


def test_places_go_to_the_map_and_back(hills, hills_map):
    _, start, _ = hills
    x_m, y_m = hills_map.to_map(*start)
    assert hills_map.west_m < x_m < hills_map.west_m + hills_map.columns * hills_map.cell_m
    assert hills_map.to_geodetic(x_m, y_m) == pytest.approx(start, abs=2e-8)


def test_errors_are_of_their_kind_and_say_what_to_do(tmp_path):
    with pytest.raises(hedgehop.DataError) as data:
        hedgehop.read_map(tmp_path / "nowhere")
    assert "nowhere" in str(data.value) and data.value.exit_code == 5
    with pytest.raises(hedgehop.ConfigError) as config:
        prepare_slope(tmp_path, config_file=tmp_path / "slope.asc")
    assert config.value.exit_code == 2
    prepare_slope(tmp_path)
    with pytest.raises(hedgehop.UsageError) as usage:
        prepare_slope(tmp_path)
    assert "overwrite" in usage.value.hint
    prepare_slope(tmp_path, overwrite=True)
    assert issubclass(hedgehop.DataError, hedgehop.UserError) and issubclass(hedgehop.MessageError, hedgehop.DataError)
    with pytest.raises(hedgehop.DataError):
        hedgehop.read_plan(tmp_path)

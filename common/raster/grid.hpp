#pragma once

#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "base/errors.hpp"
#include "geo/geodetic_box.hpp"
#include "geo/map_projection.hpp"

namespace hedgehop::raster {

struct CellIndex {
  int column = 0;  // grows east
  int row = 0;  // grows north; row 0 is the southernmost (files are north-up: flipped on reading)

  bool operator==(const CellIndex&) const = default;
};

/// Where the cells of a raster lie in the map frame. Cells are square and axis-parallel.
struct GridGeometry {
  double west_m = 0.0;   // x of the outer edge of column 0
  double south_m = 0.0;  // y of the outer edge of row 0
  double cell_m = 0.0;
  int columns = 0;
  int rows = 0;

  bool operator==(const GridGeometry&) const = default;

  [[nodiscard]] double east_m() const { return west_m + columns * cell_m; }
  [[nodiscard]] double north_m() const { return south_m + rows * cell_m; }
  [[nodiscard]] std::size_t cell_count() const {
    return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  }
  [[nodiscard]] bool contains(CellIndex cell) const {
    return cell.column >= 0 && cell.column < columns && cell.row >= 0 && cell.row < rows;
  }
  [[nodiscard]] bool contains(const geo::MapPoint& point) const {
    return point.x_m >= west_m && point.x_m < east_m() && point.y_m >= south_m &&
           point.y_m < north_m();
  }
  /// The cell that holds the point; may lie outside the raster. The point must be finite and within
  /// 1e8 cells of it.
  [[nodiscard]] CellIndex cell_at(const geo::MapPoint& point) const {
    return {static_cast<int>(std::floor((point.x_m - west_m) / cell_m)),
            static_cast<int>(std::floor((point.y_m - south_m) / cell_m))};
  }
  [[nodiscard]] geo::MapPoint centre(CellIndex cell) const {
    return {west_m + (cell.column + 0.5) * cell_m, south_m + (cell.row + 0.5) * cell_m};
  }
};

/// The parallels and meridians that hold a grid, from 33 points on each of its edges; a bulge
/// between them of some metres is not in it.
geo::GeodeticBox geodetic_box(const GridGeometry& geometry, const geo::MapProjection& projection);

/// A raster in memory, row by row from the south. T is float for heights (NaN = unknown) or an
/// integer type.
template <typename T>
class Grid {
 public:
  Grid() = default;
  Grid(const GridGeometry& geometry, T value) : geometry_(geometry) {
    HEDGEHOP_ASSERT(geometry.columns >= 0 && geometry.rows >= 0);
    values_.assign(geometry.cell_count(), value);
  }

  [[nodiscard]] const GridGeometry& geometry() const { return geometry_; }
  [[nodiscard]] int columns() const { return geometry_.columns; }
  [[nodiscard]] int rows() const { return geometry_.rows; }
  [[nodiscard]] bool is_empty() const { return values_.empty(); }

  /// Not checked: the cell must be inside.
  [[nodiscard]] T at(int column, int row) const { return values_[index(column, row)]; }
  [[nodiscard]] T& at(int column, int row) { return values_[index(column, row)]; }
  [[nodiscard]] T at(CellIndex cell) const { return at(cell.column, cell.row); }
  [[nodiscard]] T& at(CellIndex cell) { return at(cell.column, cell.row); }
  [[nodiscard]] const T* row(int row) const { return values_.data() + index(0, row); }
  [[nodiscard]] T* row(int row) { return values_.data() + index(0, row); }

  /// All values, row by row from the south.
  [[nodiscard]] const std::vector<T>& values() const { return values_; }
  [[nodiscard]] std::vector<T>& values() { return values_; }

 private:
  [[nodiscard]] std::size_t index(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(geometry_.columns) +
           static_cast<std::size_t>(column);
  }

  GridGeometry geometry_;
  std::vector<T> values_;
};

/// Bilinear interpolation between cell centres; constant beyond the outermost centres, NaN outside
/// the raster and next to a NaN that takes part with a weight above zero.
double sample_bilinear(const Grid<float>& grid, const geo::MapPoint& point);

/// The greatest value of the cells whose area the disc touches; NaN if one of them is NaN or
/// outside.
double max_within(const Grid<float>& grid, const geo::MapPoint& centre, double radius_m);

}  // namespace hedgehop::raster

#include "preparation/visibility.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <tbb/blocked_range.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "map/map.hpp"
#include "preparation/visibility_lines.hpp"

namespace hedgehop::preparation {
namespace {

constexpr char kStage[] = "visibility";
constexpr int kTileRowsMax = 512;
constexpr int kTileColumnsMax = 512;

// A part of a raster with a margin of unknown cells, so that rays need no bounds checks.
template <typename T>
struct Padded {
  int first_column = 0;  // in the frame of the pass, of values[0]
  int first_row = 0;
  std::ptrdiff_t stride = 0;
  std::vector<T> values;

  [[nodiscard]] const T* at(int column, int row) const {
    return values.data() + (row - first_row) * stride + (column - first_column);
  }
};

struct Window {
  int column = 0;
  int row = 0;
  int columns = 0;
  int rows = 0;
};

// The part of a window that lies in the raster; both in the frame of the pass.
template <typename T>
Window inside(const Window& window, const raster::Grid<T>& grid, bool is_transposed) {
  const int columns = is_transposed ? grid.rows() : grid.columns();
  const int rows = is_transposed ? grid.columns() : grid.rows();
  const int column = std::clamp(window.column, 0, columns);
  const int row = std::clamp(window.row, 0, rows);
  return {column, row, std::clamp(window.column + window.columns, column, columns) - column,
          std::clamp(window.row + window.rows, row, rows) - row};
}

// `window` may stick out of the raster and is given in the frame of the pass.
template <typename To, typename From, typename ValueOf>
Padded<To> padded(const raster::Grid<From>& grid, const Window& window, bool is_transposed,
                  To beyond, const ValueOf& value_of) {
  Padded<To> result;
  result.first_column = window.column;
  result.first_row = window.row;
  // An odd number of cache lines for 16 bits, so that the rows of a column do not fight for one
  // place.
  constexpr int kLine = 32;
  result.stride = ((window.columns + kLine - 1) / kLine | 1) * kLine;
  result.values.assign(
      static_cast<std::size_t>(result.stride) * static_cast<std::size_t>(window.rows), beyond);
  const Window part = inside(window, grid, is_transposed);
  // In squares, so that the transposed raster is written without a cache miss a cell.
  constexpr int kSquare = 64;
  for (int square_row = 0; square_row < part.rows; square_row += kSquare) {
    for (int square_column = 0; square_column < part.columns; square_column += kSquare) {
      for (int i = square_row; i < std::min(square_row + kSquare, part.rows); ++i) {
        const int row = part.row + i;
        To* target = result.values.data() + (row - window.row) * result.stride +
                     (part.column - window.column);
        for (int k = square_column; k < std::min(square_column + kSquare, part.columns); ++k) {
          const int column = part.column + k;
          target[k] = value_of(is_transposed ? grid.at(row, column) : grid.at(column, row));
        }
      }
    }
  }
  return result;
}

// Rays along the rows of the raster, or of the transposed raster, from every cell of the block.
struct Pass {
  bool is_transposed = false;
  int column = 0;  // of the block, in the frame of the pass
  int row = 0;
  int columns = 0;
  int rows = 0;
  std::int64_t absolute_row = 0;  // of the raster's row 0
  std::vector<SightLine> lines;
  std::vector<ColumnSpan> spans;         // by row of the block
  std::optional<CellRectangle> changed;  // in the frame of the pass: only rays that may cross it
  // By cell of the block; `further` in planes: at reference height on the lines with further
  // heights, at each further height, known on these lines.
  std::vector<std::int32_t> seen;
  std::vector<std::int32_t> known;
  std::vector<std::int32_t> further;

  [[nodiscard]] std::size_t cell_count() const {
    return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  }
};

struct Tile {
  Pass* pass = nullptr;
  int column = 0;  // in the block
  int row = 0;
  int columns = 0;
  int rows = 0;
};

// Room on each side of a row of observers, since strips reach beyond.
constexpr int kIdleLanes = 2 * kLanesMax;

// Ground and observers of a tile; heights are counted from the tile's own zero.
template <typename T>
struct TileGround {
  Padded<T> ground;
  Padded<std::uint16_t> weight;  // empty: all ground counts
  std::ptrdiff_t stride = 0;     // of the arrays for observers
  std::ptrdiff_t plane = 0;
  std::vector<T> eyes;
  std::vector<std::int32_t> seen;
  std::vector<std::int32_t> known;
  std::vector<std::int32_t> further;
  LineBuffers<T> buffers;
};

// Columns of the block that are wanted in a row of a tile.
ColumnSpan span_of(const Tile& tile, int row) {
  const ColumnSpan& span = tile.pass->spans[static_cast<std::size_t>(tile.row + row)];
  return {std::max(span.begin, tile.column), std::min(span.end, tile.column + tile.columns)};
}

// Columns of the block from which a ray of this line, in either direction, may meet what has
// changed. A sample looks at up to two cells on each side, and a ray lies beside its observer.
ColumnSpan crossing_span(const Pass& pass, const SightLine& line, int row) {
  constexpr double kBeside = 3.0;
  const CellRectangle& changed = *pass.changed;
  const double slope = static_cast<double>(line.slope) / 4294967296.0;
  const double to_first = slope * (changed.row - row);
  const double to_last = slope * (changed.row + changed.rows - 1 - row);
  const double begin = changed.column - std::max(to_first, to_last) - kBeside;
  const double end = changed.column + changed.columns - std::min(to_first, to_last) + kBeside;
  return {static_cast<int>(std::floor(begin)) - pass.column,
          static_cast<int>(std::ceil(end)) - pass.column};
}

template <typename T>
void add_line(const Tile& tile, const SightLine& line, int further_count, TileGround<T>& of_tile,
              const LineKernel& kernel) {
  const Pass& pass = *tile.pass;
  const int reach = line.steps.count;
  // Blocks are anchored to the map frame.
  const int lowest_row = pass.row + tile.row - reach;
  const int idle_rows = static_cast<int>((pass.absolute_row + lowest_row) & (kBlockRows - 1));
  const int first_row = lowest_row - idle_rows;  // of the buffer, in the raster
  const int buffer_rows =
      (idle_rows + tile.rows + 2 * reach + kBlockRows - 1) / kBlockRows * kBlockRows;
  std::vector<std::int32_t> left(static_cast<std::size_t>(buffer_rows));
  std::vector<std::int16_t> fraction(static_cast<std::size_t>(buffer_rows));
  std::vector<ObserverRow> rows;
  std::array<std::int32_t, 2 * kExactSteps> exact_left{};
  std::array<std::int16_t, 2 * kExactSteps> exact_fraction{};
  for (int i = 0; i < 2 * kExactSteps; ++i) {
    const int rows_ahead = i < kExactSteps ? i + 1 : kExactSteps - 1 - i;
    const Crossing crossing = crossing_beside(line.slope, rows_ahead);
    exact_left[static_cast<std::size_t>(i)] = crossing.left;
    exact_fraction[static_cast<std::size_t>(i)] = crossing.fraction;
  }
  LineTask<T> task;
  task.ground = of_tile.ground.at(0, first_row);
  task.ground_weight = of_tile.weight.values.empty() ? nullptr : of_tile.weight.at(0, first_row);
  task.stride = of_tile.ground.stride;
  task.left = left.data();
  task.fraction = fraction.data();
  task.exact_left = exact_left.data();
  task.exact_fraction = exact_fraction.data();
  task.buffer_rows = buffer_rows;
  task.steps = &line.steps;
  task.further_count = further_count;
  task.rows = &rows;
  task.eyes = of_tile.eyes.data();
  task.seen = of_tile.seen.data();
  task.known = of_tile.known.data();
  task.further = of_tile.further.data();
  task.further_plane = of_tile.plane;
  for (int phase = 0; phase < kPhases; ++phase) {
    rows.clear();
    for (int row = 0; row < tile.rows; ++row) {
      const Foot foot = foot_on_line(line.slope, pass.absolute_row + pass.row + tile.row + row);
      ColumnSpan span = span_of(tile, row);
      if (pass.changed) {
        const ColumnSpan crossing = crossing_span(pass, line, pass.row + tile.row + row);
        span = {std::max(span.begin, crossing.begin), std::min(span.end, crossing.end)};
      }
      if (foot.phase != phase || span.begin >= span.end) {
        continue;
      }
      const int skew = pass.column + foot.shift;
      rows.push_back({idle_rows + reach + row, skew + span.begin, skew + span.end,
                      row * of_tile.stride - skew - tile.column + kIdleLanes, foot.shift});
    }
    if (rows.empty()) {
      continue;
    }
    for (int b = 0; b < buffer_rows; ++b) {
      const Crossing crossing =
          crossing_of_line(line.slope, phase, pass.absolute_row + first_row + b);
      left[static_cast<std::size_t>(b)] = crossing.left;
      fraction[static_cast<std::size_t>(b)] = crossing.fraction;
    }
    add_lines(task, of_tile.buffers, kernel);
  }
}

struct Work {
  const VisibilityGround* ground = nullptr;
  double radius_m = 0.0;
  float reference_height_m = 0.0F;
  int units_per_metre = 0;
  int further_count = 0;
  bool only_further = false;  // lines without further heights have been done
  LineKernel kernel;
};

// What the rays of a tile may meet.
Window window_of(const Tile& tile, const Work& work) {
  const Pass& pass = *tile.pass;
  const double cell_m = work.ground->surface_m.geometry().cell_m;
  // The lines of a tile run on beyond their own observers' reach, and groups have idle lanes.
  const int reach = static_cast<int>(std::ceil(work.radius_m / cell_m)) + kBlockRows;
  const int beside = reach + tile.rows + kIdleLanes;
  return {pass.column + tile.column - beside, pass.row + tile.row - reach,
          tile.columns + 2 * beside, tile.rows + 2 * reach};
}

// Calls eye_of(column, row, eye) for each observer, counted in the block, with its eye in units.
template <typename EyeOf>
void for_each_eye(const Tile& tile, const Work& work, const EyeOf& eye_of) {
  const Pass& pass = *tile.pass;
  const raster::Grid<float>& surface_m = work.ground->surface_m;
  for (int row = 0; row < tile.rows; ++row) {
    const ColumnSpan span = span_of(tile, row);
    for (int column = span.begin; column < span.end; ++column) {
      const int c = pass.column + column;
      const int r = pass.row + tile.row + row;
      const float z_m = pass.is_transposed ? surface_m.at(r, c) : surface_m.at(c, r);
      if (!std::isnan(z_m)) {
        eye_of(column, row, eye_in_units(z_m, work.reference_height_m, work.units_per_metre));
      }
    }
  }
}

// Heights of a tile's ground and eyes in units.
struct HeightRange {
  int lowest = std::numeric_limits<int>::max();
  int highest = std::numeric_limits<int>::min();

  void add(int height) {
    lowest = std::min(lowest, height);
    highest = std::max(highest, height);
  }
  // Lanes of 16 bits hold them, counted from the middle, less what is no height.
  [[nodiscard]] bool is_narrow() const { return lowest > highest || highest - lowest < 65500; }
  [[nodiscard]] int middle() const {
    return lowest > highest ? 0 : lowest + (highest - lowest) / 2;
  }
};

HeightRange height_range(const Tile& tile, const Work& work, const Window& window) {
  const raster::Grid<float>& opaque_m = work.ground->opaque_m;
  const bool is_transposed = tile.pass->is_transposed;
  const Window part = inside(window, opaque_m, is_transposed);
  const int columns = is_transposed ? part.rows : part.columns;
  const int column = is_transposed ? part.row : part.column;
  const int row = is_transposed ? part.column : part.row;
  float lowest_m = std::numeric_limits<float>::infinity();
  float highest_m = -lowest_m;
  for (int i = 0; i < (is_transposed ? part.columns : part.rows); ++i) {
    const float* of_row = opaque_m.row(row + i) + column;
    for (int k = 0; k < columns; ++k) {
      // In this order an unknown height changes nothing.
      lowest_m = std::min(lowest_m, of_row[k]);
      highest_m = std::max(highest_m, of_row[k]);
    }
  }
  HeightRange range;
  if (lowest_m <= highest_m) {
    range.add(ground_in_units(lowest_m, work.units_per_metre));
    range.add(ground_in_units(highest_m, work.units_per_metre));
  }
  for_each_eye(tile, work, [&](int, int, int eye) { range.add(eye); });
  return range;
}

// Calls `line_done` after each line of the pass. Heights are counted from `zero`.
template <typename T, typename LineDone>
void run_tile(const Tile& tile, const Work& work, const Window& window, int zero,
              Observer& observer, const LineDone& line_done) {
  Pass& pass = *tile.pass;
  TileGround<T> of_tile;
  of_tile.ground =
      padded(work.ground->opaque_m, window, pass.is_transposed, kUnknownHeight<T>, [&](float z_m) {
        return std::isnan(z_m) ? kUnknownHeight<T>
                               : static_cast<T>(ground_in_units(z_m, work.units_per_metre) - zero);
      });
  if (work.ground->weight != nullptr) {
    of_tile.weight =
        padded(*work.ground->weight, window, pass.is_transposed, std::uint16_t{0}, weight_in_units);
  }
  of_tile.stride = tile.columns + 2 * kIdleLanes;
  of_tile.plane = of_tile.stride * tile.rows;
  const auto plane = static_cast<std::size_t>(of_tile.plane);
  const std::size_t further_planes = work.further_count == 0 ? 0 : work.further_count + 2;
  of_tile.eyes.assign(plane, kBlindEye<T>);
  of_tile.seen.assign(plane, 0);
  of_tile.known.assign(plane, 0);
  of_tile.further.assign(further_planes * plane, 0);
  for_each_eye(tile, work, [&](int column, int row, int eye) {
    const std::ptrdiff_t at = row * of_tile.stride + kIdleLanes + column - tile.column;
    of_tile.eyes[static_cast<std::size_t>(at)] = static_cast<T>(eye - zero);
  });
  // Sums of known ground are less what follows.
  std::int32_t known = 0;
  std::int32_t further_known = 0;
  for (const SightLine& line : pass.lines) {
    if (work.only_further && !line.has_further) {
      line_done();
      continue;
    }
    observer.check_stop();
    add_line(tile, line, line.has_further ? work.further_count : 0, of_tile, work.kernel);
    known += 2 * line.ray_weight;
    further_known += line.has_further ? 2 * line.ray_weight : 0;
    line_done();
  }
  const auto copy = [&](const std::int32_t* from, std::int32_t more, std::int32_t* to) {
    std::transform(from, from + tile.columns, to,
                   [more](std::int32_t value) { return value + more; });
  };
  for (int row = 0; row < tile.rows; ++row) {
    const std::ptrdiff_t from = row * of_tile.stride + kIdleLanes;
    const std::ptrdiff_t to =
        static_cast<std::ptrdiff_t>(tile.row + row) * pass.columns + tile.column;
    if (!work.only_further) {
      copy(of_tile.seen.data() + from, 0, pass.seen.data() + to);
      copy(of_tile.known.data() + from, known, pass.known.data() + to);
    }
    for (std::size_t p = 0; p < further_planes; ++p) {
      copy(of_tile.further.data() + p * plane + from, p + 1 == further_planes ? further_known : 0,
           pass.further.data() + p * pass.cell_count() + to);
    }
  }
}

template <typename LineDone>
void run_tile(const Tile& tile, const Work& work, Observer& observer, const LineDone& line_done) {
  const Window window = window_of(tile, work);
  const HeightRange range = height_range(tile, work, window);
  if (work.units_per_metre == kUnitsPerMetre && range.is_narrow()) {
    run_tile<std::int16_t>(tile, work, window, range.middle(), observer, line_done);
  } else {
    run_tile<std::int32_t>(tile, work, window, range.middle(), observer, line_done);
  }
}

std::vector<Tile> tiles_of(Pass& pass) {
  std::vector<Tile> tiles;
  const int across = (pass.columns + kTileColumnsMax - 1) / kTileColumnsMax;
  const int along = (pass.rows + kTileRowsMax - 1) / kTileRowsMax;
  for (int i = 0; i < along; ++i) {
    for (int k = 0; k < across; ++k) {
      Tile tile{&pass, 0, 0, 0, 0};
      tile.row = static_cast<int>(std::int64_t{pass.rows} * i / along);
      tile.rows = static_cast<int>(std::int64_t{pass.rows} * (i + 1) / along) - tile.row;
      tile.column = static_cast<int>(std::int64_t{pass.columns} * k / across);
      tile.columns = static_cast<int>(std::int64_t{pass.columns} * (k + 1) / across) - tile.column;
      tiles.push_back(tile);
    }
  }
  return tiles;
}

// For each column of the block the rows between its first and its last wanted cell.
std::vector<ColumnSpan> transposed(const std::vector<ColumnSpan>& spans, int columns) {
  std::vector<ColumnSpan> result(static_cast<std::size_t>(columns),
                                 {std::numeric_limits<int>::max(), 0});
  for (std::size_t row = 0; row < spans.size(); ++row) {
    for (int column = std::max(spans[row].begin, 0); column < std::min(spans[row].end, columns);
         ++column) {
      ColumnSpan& target = result[static_cast<std::size_t>(column)];
      target.begin = std::min(target.begin, static_cast<int>(row));
      target.end = static_cast<int>(row) + 1;
    }
  }
  return result;
}

Pass pass_over(const VisibilityGround& ground, raster::CellIndex block, int columns, int rows,
               const std::vector<ColumnSpan>* spans, const CellRectangle* changed,
               bool is_transposed) {
  const raster::GridGeometry& g = ground.surface_m.geometry();
  Pass pass;
  pass.is_transposed = is_transposed;
  pass.column = is_transposed ? block.row : block.column;
  pass.row = is_transposed ? block.column : block.row;
  pass.columns = is_transposed ? rows : columns;
  pass.rows = is_transposed ? columns : rows;
  pass.absolute_row = rows_from_origin(is_transposed ? g.west_m : g.south_m, g.cell_m);
  std::vector<ColumnSpan> of_rows(static_cast<std::size_t>(rows), {0, columns});
  if (spans != nullptr) {
    of_rows = *spans;
  }
  pass.spans = is_transposed ? transposed(of_rows, columns) : std::move(of_rows);
  if (changed != nullptr) {
    pass.changed = is_transposed ? CellRectangle{changed->row, changed->column, changed->rows,
                                                 changed->columns}
                                 : *changed;
  }
  pass.seen.assign(pass.cell_count(), 0);
  pass.known.assign(pass.cell_count(), 0);
  return pass;
}

// Both passes' sums of a cell of the block.
std::int64_t sum_of(const std::vector<std::int32_t>& along_y,
                    const std::vector<std::int32_t>& along_x, std::size_t plane, int columns,
                    int rows, int column, int row) {
  const auto width = static_cast<std::size_t>(columns);
  const auto height = static_cast<std::size_t>(rows);
  const auto c = static_cast<std::size_t>(column);
  const auto r = static_cast<std::size_t>(row);
  return std::int64_t{along_y[(plane * height + r) * width + c]} +
         along_x[(plane * width + c) * height + r];
}

// Further heights that are looked from together.
struct Round {
  std::size_t first = 0;  // of them
  std::size_t count = 0;
  std::size_t first_plane = 0;  // of VisibilitySums
};

std::vector<Round> rounds_of(std::size_t height_count) {
  std::vector<Round> rounds;
  std::size_t plane = 2;
  for (std::size_t first = 0; rounds.empty() || first < height_count; first += kFurtherHeightsMax) {
    const std::size_t count = std::min<std::size_t>(kFurtherHeightsMax, height_count - first);
    rounds.push_back({first, count, plane});
    plane += count == 0 ? 0 : count + 2;
  }
  return rounds;
}

// A block, or those of its rays that what has changed concerns.
struct BlockWork {
  raster::CellIndex block;
  int columns = 0;
  int rows = 0;
  const std::vector<ColumnSpan>* spans = nullptr;  // null: all
  const CellRectangle* changed = nullptr;          // null: all rays
  double progress_begin = 0.0;
  double progress_end = 1.0;
};

// Calls round_done(round, sum) after each round, where sum(plane, cell) is what a plane of
// VisibilitySums holds.
template <typename RoundDone>
void run_rounds(const VisibilityGround& ground, const BlockWork& block,
                const VisibilityOptions& options, const VisibilityExecution& execution,
                Observer& observer, const RoundDone& round_done) {
  const raster::GridGeometry& g = ground.surface_m.geometry();
  const LineKernel kernel = line_kernel(execution.simd);
  const auto progress = [&](double done) {
    observer.progress(
        kStage, block.progress_begin + done * (block.progress_end - block.progress_begin), 1.0);
  };
  progress(0.0);
  const int processors = tbb::info::default_concurrency();
  tbb::task_arena arena(execution.threads > 0 ? std::min(execution.threads, processors)
                                              : processors);
  Pass along_y;
  Pass along_x;
  arena.execute([&] {
    tbb::parallel_for(0, 2, [&](int is_transposed) {
      (is_transposed == 1 ? along_x : along_y) =
          pass_over(ground, block.block, block.columns, block.rows, block.spans, block.changed,
                    is_transposed == 1);
    });
  });
  std::vector<Tile> tiles = tiles_of(along_y);
  const std::vector<Tile> more_tiles = tiles_of(along_x);
  tiles.insert(tiles.end(), more_tiles.begin(), more_tiles.end());
  const std::vector<Round> rounds = rounds_of(options.further_heights_m.size());
  for (std::size_t r = 0; r < rounds.size(); ++r) {
    const Round& round = rounds[r];
    VisibilityOptions part = options;
    part.further_heights_m.assign(
        options.further_heights_m.begin() + static_cast<std::ptrdiff_t>(round.first),
        options.further_heights_m.begin() + static_cast<std::ptrdiff_t>(round.first + round.count));
    for (Pass* pass : {&along_y, &along_x}) {
      pass->lines = sight_lines(part, g.cell_m, pass->is_transposed);
      pass->further.assign(round.count == 0 ? 0 : (round.count + 2) * pass->cell_count(), 0);
    }
    const Work work{&ground,
                    options.radius_m,
                    static_cast<float>(options.reference_height_m),
                    units_per_metre(options),
                    static_cast<int>(round.count),
                    r > 0,
                    kernel};
    std::size_t line_count = 0;
    for (const Tile& tile : tiles) {
      line_count += tile.pass->lines.size();
    }
    std::atomic<std::size_t> lines_done = 0;
    const auto line_done = [&] {
      const double done = static_cast<double>(++lines_done) / static_cast<double>(line_count);
      progress((static_cast<double>(r) + done) / static_cast<double>(rounds.size()));
    };
    arena.execute([&] {
      tbb::parallel_for(std::size_t{0}, tiles.size(),
                        [&](std::size_t i) { run_tile(tiles[i], work, observer, line_done); });
    });
    round_done(round, [&](std::size_t plane, raster::CellIndex cell) {
      const auto of = [&](const std::vector<std::int32_t>& y, const std::vector<std::int32_t>& x,
                          std::size_t at) {
        return sum_of(y, x, at, block.columns, block.rows, cell.column, cell.row);
      };
      return plane == 0   ? of(along_y.seen, along_x.seen, 0)
             : plane == 1 ? of(along_y.known, along_x.known, 0)
                          : of(along_y.further, along_x.further, plane - round.first_plane);
    });
  }
}

// Writes what a round tells of a cell with known surface, sum(plane) being its sums.
template <typename SumAt>
void write_shares(const Round& round, const SumAt& sum, raster::CellIndex cell,
                  VisibilityLayers& layers) {
  const std::int64_t known = sum(1);
  if (known == 0) {
    return;
  }
  const double share = static_cast<double>(sum(0)) / static_cast<double>(known);
  if (round.first == 0) {
    layers.shares[0].at(cell) = stored_share(share);
  }
  for (std::size_t i = 0; i < round.count; ++i) {
    const std::int64_t seen = sum(round.first_plane);
    layers.shares[round.first + i + 1].at(cell) = further_share(
        share, sum(round.first_plane + i + 1) - seen, sum(round.first_plane + round.count + 1));
  }
}

// Calls cell_of(cell) for each cell of the spans, all without spans.
template <typename CellOf>
void for_each_cell(int columns, int rows, const std::vector<ColumnSpan>* spans,
                   const CellOf& cell_of) {
  for (int row = 0; row < rows; ++row) {
    const ColumnSpan span =
        spans == nullptr ? ColumnSpan{0, columns} : (*spans)[static_cast<std::size_t>(row)];
    for (int column = std::max(span.begin, 0); column < std::min(span.end, columns); ++column) {
      cell_of(raster::CellIndex{column, row});
    }
  }
}

}  // namespace

VisibilityLayers visibility_of_block(const VisibilityGround& ground, raster::CellIndex block,
                                     int columns, int rows, const VisibilityOptions& options,
                                     const VisibilityExecution& execution, Observer& observer,
                                     const std::vector<ColumnSpan>* spans, VisibilitySums* sums) {
  const raster::GridGeometry& g = ground.surface_m.geometry();
  validate(options, g.cell_m);
  validate(ground, block, columns, rows);
  if (spans != nullptr && spans->size() != static_cast<std::size_t>(rows)) {
    throw std::invalid_argument("visibility: one span of columns is needed for each row");
  }
  const std::size_t height_count = options.further_heights_m.size();
  VisibilityLayers layers;
  const raster::GridGeometry geometry = geometry_of_block(g, block, columns, rows);
  layers.shares.assign(height_count + 1,
                       raster::Grid<std::uint16_t>(geometry, map::kVisibilityUnknown));
  layers.is_partial = partial_surroundings(ground.opaque_m, block, columns, rows, options.radius_m);
  if (sums != nullptr) {
    const Round last = rounds_of(height_count).back();
    sums->planes.assign(last.first_plane + (last.count == 0 ? 0 : last.count + 2),
                        raster::Grid<std::int64_t>(geometry, 0));
  }
  run_rounds(
      ground, {block, columns, rows, spans}, options, execution, observer,
      [&](const Round& round, const auto& sum) {
        for_each_cell(columns, rows, spans, [&](raster::CellIndex cell) {
          if (sums != nullptr) {
            for (std::size_t plane = 0; plane < 2; ++plane) {
              sums->planes[plane].at(cell) = sum(plane, cell);
            }
            for (std::size_t i = 0; round.count > 0 && i < round.count + 2; ++i) {
              sums->planes[round.first_plane + i].at(cell) = sum(round.first_plane + i, cell);
            }
          }
          if (!std::isnan(ground.surface_m.at(block.column + cell.column, block.row + cell.row))) {
            write_shares(
                round, [&](std::size_t plane) { return sum(plane, cell); }, cell, layers);
          }
        });
      });
  order_by_height(options, layers.shares);
  observer.progress(kStage, 1.0, 1.0);
  return layers;
}

void update_visibility_of_block(const VisibilityGround& before, const VisibilityGround& ground,
                                raster::CellIndex block, const CellRectangle& changed,
                                const VisibilityOptions& options,
                                const VisibilityExecution& execution, Observer& observer,
                                VisibilityLayers& layers, VisibilitySums& sums) {
  const std::vector<Round> rounds = rounds_of(options.further_heights_m.size());
  const std::size_t plane_count =
      rounds.back().first_plane + (rounds.back().count == 0 ? 0 : rounds.back().count + 2);
  if (layers.shares.size() != options.further_heights_m.size() + 1 ||
      sums.planes.size() != plane_count) {
    throw std::invalid_argument("visibility: layers or sums have not the heights of the options");
  }
  if (before.surface_m.geometry() != ground.surface_m.geometry() ||
      (before.weight == nullptr) != (ground.weight == nullptr)) {
    throw std::invalid_argument("visibility: the ground was another raster before");
  }
  const raster::GridGeometry& g = ground.surface_m.geometry();
  const int columns = layers.shares.front().columns();
  const int rows = layers.shares.front().rows();
  validate(options, g.cell_m);
  validate(ground, block, columns, rows);
  if (changed.columns < 1 || changed.rows < 1) {
    return;
  }
  // A sample lies up to one cell beside what it is interpolated from, and a ray beside its
  // observer.
  const double reach = options.radius_m / g.cell_m + 2.0;
  const int whole_reach = static_cast<int>(std::ceil(reach));
  const int row_begin = std::max(changed.row - whole_reach, block.row);
  const int row_end = std::min(changed.row + changed.rows + whole_reach, block.row + rows);
  const int column_begin = std::max(changed.column - whole_reach, block.column);
  const int column_end =
      std::min(changed.column + changed.columns + whole_reach, block.column + columns);
  if (row_begin >= row_end || column_begin >= column_end) {
    return;
  }
  std::vector<ColumnSpan> spans;
  for (int row = row_begin; row < row_end; ++row) {
    const int away = std::max({changed.row - row, row - (changed.row + changed.rows - 1), 0});
    const double square = reach * reach - static_cast<double>(away) * away;
    if (square < 0.0) {
      spans.push_back({0, 0});
      continue;
    }
    const int half = static_cast<int>(std::ceil(std::sqrt(square)));
    spans.push_back({std::max(changed.column - half, column_begin) - column_begin,
                     std::min(changed.column + changed.columns + half, column_end) - column_begin});
  }
  // Rays that meet what has changed: what they saw is taken back, what they see is added.
  const int update_columns = column_end - column_begin;
  const int update_rows = row_end - row_begin;
  const raster::CellIndex corner{column_begin, row_begin};
  const raster::GridGeometry geometry = geometry_of_block(g, corner, update_columns, update_rows);
  std::vector<raster::Grid<std::int64_t>> more(plane_count,
                                               raster::Grid<std::int64_t>(geometry, 0));
  for (const bool is_before : {true, false}) {
    const BlockWork work{corner,   update_columns,        update_rows,          &spans,
                         &changed, is_before ? 0.0 : 0.5, is_before ? 0.5 : 1.0};
    run_rounds(is_before ? before : ground, work, options, execution, observer,
               [&](const Round& round, const auto& sum) {
                 for_each_cell(update_columns, update_rows, &spans, [&](raster::CellIndex cell) {
                   const auto add = [&](std::size_t plane) {
                     more[plane].at(cell) += is_before ? -sum(plane, cell) : sum(plane, cell);
                   };
                   if (round.first == 0) {
                     add(0);
                     add(1);
                   }
                   for (std::size_t i = 0; round.count > 0 && i < round.count + 2; ++i) {
                     add(round.first_plane + i);
                   }
                 });
               });
  }
  VisibilityLayers update;
  update.shares.assign(layers.shares.size(),
                       raster::Grid<std::uint16_t>(geometry, map::kVisibilityUnknown));
  update.is_partial =
      partial_surroundings(ground.opaque_m, corner, update_columns, update_rows, options.radius_m);
  for_each_cell(update_columns, update_rows, &spans, [&](raster::CellIndex cell) {
    const raster::CellIndex in_block{corner.column + cell.column - block.column,
                                     corner.row + cell.row - block.row};
    for (std::size_t plane = 0; plane < plane_count; ++plane) {
      sums.planes[plane].at(in_block) += more[plane].at(cell);
    }
    if (!std::isnan(ground.surface_m.at(corner.column + cell.column, corner.row + cell.row))) {
      for (const Round& round : rounds) {
        write_shares(
            round, [&](std::size_t plane) { return sums.planes[plane].at(in_block); }, cell,
            update);
      }
    }
  });
  order_by_height(options, update.shares);
  for (int row = row_begin; row < row_end; ++row) {
    const ColumnSpan& span = spans[static_cast<std::size_t>(row - row_begin)];
    if (span.begin >= span.end) {
      continue;
    }
    const int to = column_begin + span.begin - block.column;
    for (std::size_t i = 0; i < layers.shares.size(); ++i) {
      std::copy(update.shares[i].row(row - row_begin) + span.begin,
                update.shares[i].row(row - row_begin) + span.end,
                layers.shares[i].row(row - block.row) + to);
    }
    std::copy(update.is_partial.row(row - row_begin) + span.begin,
              update.is_partial.row(row - row_begin) + span.end,
              layers.is_partial.row(row - block.row) + to);
  }
}

}  // namespace hedgehop::preparation

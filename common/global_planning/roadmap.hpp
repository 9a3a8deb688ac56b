#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/hash.hpp"
#include "base/observer.hpp"
#include "flight/route.hpp"
#include "global_planning/cost_field.hpp"
#include "global_planning/flight_envelope.hpp"
#include "global_planning/global_planner.hpp"
#include "global_planning/lattice_directions.hpp"
#include "raster/grid.hpp"
#include "risk/cost_model.hpp"

namespace hedgehop::global_planning {

/// What flying over a map costs and allows, worked out once for many queries.
///
/// A lattice over the whole map, wide enough that each of its turns (from one of sixteen directions
/// to the next) keeps the turn radius. Of each straight edge it knows, as
/// FlightEnvelope::follow() finds them away from any start and goal, the altitudes from which the
/// edge can be flown, those that can be had at its end, and what it costs by eq. (1) as low as
/// possible and kRaised_m higher. It also holds the blocks of a CostField.
///
/// Source: the probabilistic roadmap of L. E. Kavraki, P. Svestka, J.-C. Latombe and M. H.
/// Overmars, IEEE T-RA 12(4), 1996, doi:10.1109/70.508439, with a lattice in place of samples.
class Roadmap {
 public:
  static constexpr double kRaised_m = 40.0;

  /// An edge in one direction; from_low_m > from_high_m: it cannot be flown.
  struct Edge {
    float from_low_m, from_high_m;  // altitudes from which its end can be reached
    float to_low_m, to_high_m;      // altitudes at its end that can be had
    float low_cost_m;               // as low as possible
    float raised_cost_m;            // from kRaised_m higher on
  };

  /// About a second of processor time for 600 km^2 at 30 m. Throws Interrupted if the observer says
  /// so.
  Roadmap(const risk::CostModel& costs, const GlobalOptions& options, Observer& observer);

  /// What a file holds. `key` says what it was made of; read() takes a file of that key alone.
  [[nodiscard]] Bytes written(const Hash128& key) const;
  /// Null, with the reason in `why`, for bytes that are no roadmap, are damaged, were made with
  /// another key or do not belong to a map of this geometry.
  static std::optional<Roadmap> read(ByteView bytes, const Hash128& key,
                                     const raster::GridGeometry& geometry, std::string& why);

  [[nodiscard]] int columns() const { return columns_; }
  [[nodiscard]] int rows() const { return rows_; }
  [[nodiscard]] double spacing_m() const { return spacing_m_; }
  [[nodiscard]] std::size_t edge_count() const { return edges_.size(); }
  [[nodiscard]] geo::MapPoint place(int column, int row) const {
    return {west_m_ + column * spacing_m_, south_m_ + row * spacing_m_};
  }
  /// Both nodes must be on the lattice.
  [[nodiscard]] const Edge& edge(int column, int row, int direction) const {
    return edges_[(static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
                   static_cast<std::size_t>(column)) *
                      kLatticeDirections +
                  static_cast<std::size_t>(direction)];
  }
  /// Rules that edges keep, with which a query joins its ends.
  [[nodiscard]] static FlightEnvelope::FollowRules rules();
  /// A field over the same blocks to any target.
  [[nodiscard]] const CostField& field() const { return *field_; }

 private:
  Roadmap() = default;

  raster::GridGeometry cells_;  // of the map
  double spacing_m_ = 0.0;
  double west_m_ = 0.0, south_m_ = 0.0;  // of the first node
  int columns_ = 0, rows_ = 0;
  std::vector<Edge> edges_;  // of each node in all directions
  std::optional<CostField> field_;
};

/// A first route from start to goal of the envelope by a roadmap of its map: free legs from the
/// start to nodes and from nodes to the goal, A* between them, the whole flown at lowest_profile()
/// in the envelope itself, so that what was stored can make a route dear, not unlawful. Empty if
/// none was found, which proves nothing. Adds the edges looked at to `work_units`.
std::vector<flight::Waypoint> roadmap_route(const FlightEnvelope& envelope, const Roadmap& roadmap,
                                            std::int64_t work_budget, std::int64_t& work_units,
                                            const std::function<bool()>& should_stop);

}  // namespace hedgehop::global_planning

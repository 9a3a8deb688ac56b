#pragma once

#include <array>
#include <cstdint>
#include <optional>

namespace hedgehop::global_planning {

/// A place in plan view and a heading, counter-clockwise from east.
struct DubinsPose {
  double x_m = 0.0;
  double y_m = 0.0;
  double heading_math_rad = 0.0;
};

/// What the three parts of a path are: turns to the left and right, and straight lines.
enum class DubinsWord : std::uint8_t { kLsl, kRsr, kLsr, kRsl, kRlr, kLrl };
inline constexpr std::array<DubinsWord, 6> kDubinsWords = {DubinsWord::kLsl, DubinsWord::kRsr,
                                                           DubinsWord::kLsr, DubinsWord::kRsl,
                                                           DubinsWord::kRlr, DubinsWord::kLrl};

/// How a part turns: 1 to the left, -1 to the right, 0 not at all.
int turn_of(DubinsWord word, int part);

/// A curve of three parts from one pose to another: arcs of one radius and straight lines.
struct DubinsPath {
  DubinsWord word = DubinsWord::kLsl;
  double radius_m = 0.0;
  std::array<double, 3> parts_m{};  // lengths, not negative

  [[nodiscard]] double length_m() const { return parts_m[0] + parts_m[1] + parts_m[2]; }
};

/// The path of one word, if there is one. Arcs are shorter than a full circle; of the two paths of
/// a word of three arcs the one whose middle arc is longer than half a circle is meant, as the
/// other is never the shortest. Distances between the ends of up to 1e6 radii.
/// @throws std::invalid_argument  for a radius that is not positive.
std::optional<DubinsPath> dubins_path(DubinsWord word, const DubinsPose& from, const DubinsPose& to,
                                      double radius_m);

/// The shortest curve from one pose to another whose radius is nowhere less than `radius_m`. The
/// first of kDubinsWords wins where several are equally short. About a microsecond.
///
/// Source: L. E. Dubins, "On curves of minimal length with a constraint on average curvature, and
/// with prescribed initial and terminal positions and tangents", American Journal of Mathematics
/// 79(3), 1957, doi:10.2307/2372560.
DubinsPath shortest_dubins_path(const DubinsPose& from, const DubinsPose& to, double radius_m);

/// The pose after `along_m` of a path that begins at `from`; between 0 and the length.
DubinsPose pose_at(const DubinsPath& path, const DubinsPose& from, double along_m);

}  // namespace hedgehop::global_planning

#include "global_planning/track_profile.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace hedgehop::global_planning {
namespace {

// Legs may run this far above the lowest profile: fewer bends, hardly more cost.
constexpr double kBendTolerance_m = 4.0;
// Spare to the band at the samples, for what lies between them. Where that is not enough they are
// raised by what is missing, and each time by twice as much more: near start and goal there are
// only centimetres to give.
constexpr double kMargin_m = 0.5;
constexpr double kFirstRaise_m = 1.0 / 4096.0;
constexpr double kLeastStep_m = 0.01;  // between samples
constexpr int kEndSplits = 4;          // and so the samples are denser there
constexpr int kTriesMax = 16;

struct Sample {
  geo::MapPoint point;
  double along_m;
  AltitudeBand band;
  bool is_corner;
  double raise_m = kFirstRaise_m;
};

std::vector<Sample> sample_track(const FlightEnvelope& envelope,
                                 const std::vector<geo::MapPoint>& track, double step_m) {
  std::vector<Sample> samples = {{track.front(), 0.0, envelope.band_at(track.front()), true}};
  for (std::size_t leg = 1; leg < track.size(); ++leg) {
    const geo::MapPoint& a = track[leg - 1];
    const geo::MapPoint& b = track[leg];
    const double dx_m = b.x_m - a.x_m;
    const double dy_m = b.y_m - a.y_m;
    const double leg_m = std::sqrt(dx_m * dx_m + dy_m * dy_m);
    const int parts = std::max(1, static_cast<int>(std::ceil(leg_m / step_m)));
    const double begin_m = samples.back().along_m;
    const auto point_at = [&](double t) {
      return geo::MapPoint{a.x_m + t * dx_m, a.y_m + t * dy_m};
    };
    std::vector<double> shares = envelope.crossings(a, b);
    for (int k = 0; k < parts; ++k) {
      const bool is_near_end = envelope.spare_share(point_at((k + 0.5) / parts)) < 1.0;
      const int splits = is_near_end ? kEndSplits : 1;
      for (int split = 1; split <= splits; ++split) {
        shares.push_back((k + static_cast<double>(split) / splits) / parts);
      }
    }
    std::sort(shares.begin(), shares.end());
    const double least_share = kLeastStep_m / std::max(leg_m, kLeastStep_m);
    double before = 0.0;
    for (const double t : shares) {
      if (t - before > least_share && 1.0 - t > least_share) {
        const geo::MapPoint point = point_at(t);
        samples.push_back({point, begin_m + t * leg_m, envelope.band_at(point), false});
        before = t;
      }
    }
    samples.push_back({b, begin_m + leg_m, envelope.band_at(b), true});
  }
  return samples;
}

// By how much the straight leg between two samples is too low at most.
double shortfall_m(const FlightEnvelope& envelope, const flight::Waypoint& a,
                   const flight::Waypoint& b) {
  constexpr int kPieces = 8;
  double short_m = 0.0;
  for (int k = 1; k < kPieces; ++k) {
    const double t = static_cast<double>(k) / kPieces;
    const AltitudeBand band =
        envelope.band_at({a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m)});
    short_m = std::max(short_m, band.low_m - (a.altitude_m + t * (b.altitude_m - a.altitude_m)));
  }
  return short_m;
}

// Raises the floor by the spare; false where it cannot be flown.
bool take_spare(const FlightEnvelope& envelope, std::vector<Sample>& samples) {
  const std::size_t last = samples.size() - 1;
  for (std::size_t i = 0; i <= last; ++i) {
    if (!samples[i].band.is_flyable()) {
      return false;
    }
    if (i > 0 && i < last) {
      samples[i].band.low_m =
          std::min(samples[i].band.low_m + kMargin_m * envelope.spare_share(samples[i].point),
                   samples[i].band.high_m);
    }
  }
  return true;
}

// The lowest altitudes over the samples' floors that keep the slope limits; empty if none do.
std::vector<double> lowest_over(const FlightEnvelope& envelope, const std::vector<Sample>& samples,
                                double start_m, double goal_m) {
  const std::size_t last = samples.size() - 1;
  // A hair less than the limit, so that rounding does not exceed it.
  const SlopeLimits& slopes = envelope.slopes();
  constexpr double kShare = 1.0 - 1e-9;
  // Between the sample before and this one.
  const auto limit_before = [&](std::size_t i, double altitude_m) {
    return slopes.at(altitude_m, samples[i].point.x_m - samples[i - 1].point.x_m,
                     samples[i].point.y_m - samples[i - 1].point.y_m);
  };
  std::vector<double> altitude_m(samples.size());
  for (std::size_t i = 0; i <= last; ++i) {
    altitude_m[i] = samples[i].band.low_m;
  }
  altitude_m[0] = start_m;
  altitude_m[last] = goal_m;
  for (std::size_t i = 1; i <= last; ++i) {
    altitude_m[i] = std::max(altitude_m[i],
                             altitude_m[i - 1] - limit_before(i, altitude_m[i - 1]).down * kShare *
                                                     (samples[i].along_m - samples[i - 1].along_m));
  }
  for (std::size_t i = last; i-- > 0;) {
    altitude_m[i] = std::max(
        altitude_m[i], altitude_m[i + 1] - limit_before(i + 1, altitude_m[i + 1]).up * kShare *
                                               (samples[i + 1].along_m - samples[i].along_m));
  }
  constexpr double kRounding_m = 1e-6;
  if (altitude_m[0] > start_m + kRounding_m || altitude_m[last] > goal_m + kRounding_m) {
    return {};
  }
  altitude_m[0] = start_m;
  altitude_m[last] = goal_m;
  for (std::size_t i = 0; i <= last; ++i) {
    if (altitude_m[i] > samples[i].band.high_m) {
      return {};
    }
  }
  return altitude_m;
}

// Between two samples the ground rises above the line that joins them.
struct Shortfall {
  std::size_t before;  // the first of them
  double short_m;
};

// The track between two of its corners: legs end at each of them, so it is flown by itself.
struct Section {
  std::size_t first, last;             // samples
  std::vector<double> altitudes_m;     // with which it was flown
  std::vector<flight::Waypoint> ends;  // of its legs
  std::vector<Shortfall> shortfalls;
};

// Anew only if its altitudes are other ones.
void fly_section(const FlightEnvelope& envelope, const std::vector<Sample>& samples,
                 const std::vector<double>& altitude_m, Section& section) {
  const auto from = altitude_m.begin() + static_cast<std::ptrdiff_t>(section.first);
  const auto until = altitude_m.begin() + static_cast<std::ptrdiff_t>(section.last) + 1;
  if (std::equal(from, until, section.altitudes_m.begin(), section.altitudes_m.end())) {
    return;
  }
  section.altitudes_m.assign(from, until);
  section.ends.clear();
  section.shortfalls.clear();
  const auto waypoint = [&](std::size_t i) {
    return flight::Waypoint{samples[i].point.x_m, samples[i].point.y_m, altitude_m[i]};
  };
  const auto is_low = [&](std::size_t i, std::size_t j) {
    const double slope =
        (altitude_m[j] - altitude_m[i]) / (samples[j].along_m - samples[i].along_m);
    for (std::size_t k = i + 1; k < j; ++k) {
      const double here_m = altitude_m[i] + slope * (samples[k].along_m - samples[i].along_m);
      if (here_m > altitude_m[k] + kBendTolerance_m) {
        return false;
      }
    }
    return true;
  };
  for (std::size_t i = section.first; i < section.last;) {
    std::size_t best = i;
    for (std::size_t j = i + 1; j <= section.last; ++j) {
      if (is_low(i, j) && envelope.is_clear(waypoint(i), waypoint(j))) {
        best = j;
      } else if (j > best + 8) {
        break;  // farther ones seldom pass again
      }
    }
    if (best == i) {
      best = i + 1;
      section.shortfalls.push_back({i, shortfall_m(envelope, waypoint(i), waypoint(best))});
    }
    section.ends.push_back(waypoint(best));
    i = best;
  }
}

}  // namespace

std::vector<flight::Waypoint> lowest_profile(const FlightEnvelope& envelope,
                                             const std::vector<geo::MapPoint>& track,
                                             double step_m) {
  return lowest_profile(envelope, track, envelope.start().altitude_m, envelope.goal().altitude_m,
                        step_m);
}

std::vector<flight::Waypoint> lowest_profile(const FlightEnvelope& envelope,
                                             const std::vector<geo::MapPoint>& track,
                                             double start_m, double goal_m, double step_m) {
  std::vector<Sample> samples = sample_track(envelope, track, step_m);
  if (!take_spare(envelope, samples)) {
    return {};
  }
  std::vector<Section> sections;
  for (std::size_t first = 0; first + 1 < samples.size();) {
    std::size_t last = first + 1;
    while (!samples[last].is_corner) {
      ++last;
    }
    sections.push_back({first, last, {}, {}, {}});
    first = last;
  }
  for (int attempt = 0; attempt < kTriesMax; ++attempt) {
    const std::vector<double> altitude_m = lowest_over(envelope, samples, start_m, goal_m);
    if (altitude_m.empty()) {
      return {};
    }
    std::vector<double> need_m(samples.size(), 0.0);
    std::vector<std::size_t> raised;  // ascending; twice where both sides ask for it
    for (Section& section : sections) {
      fly_section(envelope, samples, altitude_m, section);
      for (const Shortfall& shortfall : section.shortfalls) {
        for (const std::size_t k : {shortfall.before, shortfall.before + 1}) {
          if (k > 0 && k + 1 < samples.size()) {
            raised.push_back(k);
            need_m[k] = std::max(need_m[k], shortfall.short_m);
          }
        }
      }
    }
    if (raised.empty()) {
      std::vector<flight::Waypoint> result = {
          {samples.front().point.x_m, samples.front().point.y_m, altitude_m.front()}};
      for (const Section& section : sections) {
        result.insert(result.end(), section.ends.begin(), section.ends.end());
      }
      return result;
    }
    raised.erase(std::unique(raised.begin(), raised.end()), raised.end());
    for (const std::size_t k : raised) {
      samples[k].band.low_m += need_m[k] + samples[k].raise_m;
      samples[k].raise_m *= 2.0;
    }
  }
  return {};
}

std::vector<flight::Waypoint> lowest_line(const FlightEnvelope& envelope,
                                          const std::vector<geo::MapPoint>& track, double start_m,
                                          double goal_m, double step_m) {
  std::vector<Sample> samples = sample_track(envelope, track, step_m);
  if (!take_spare(envelope, samples)) {
    return {};
  }
  const std::vector<double> altitude_m = lowest_over(envelope, samples, start_m, goal_m);
  std::vector<flight::Waypoint> line;
  for (std::size_t i = 0; i < altitude_m.size(); ++i) {
    line.push_back({samples[i].point.x_m, samples[i].point.y_m, altitude_m[i]});
  }
  return line;
}

std::vector<flight::Waypoint> cheaper_profile(const FlightEnvelope& envelope,
                                              const std::vector<flight::Waypoint>& route,
                                              double step_m, double compare_step_m) {
  std::vector<geo::MapPoint> track;
  for (const flight::Waypoint& waypoint : route) {
    track.push_back(waypoint.point());
  }
  std::vector<flight::Waypoint> lowest = lowest_profile(envelope, track, step_m);
  if (!lowest.empty() && !(envelope.route_cost_m(lowest, compare_step_m) <
                           envelope.route_cost_m(route, compare_step_m))) {
    lowest.clear();
  }
  return lowest;
}

}  // namespace hedgehop::global_planning

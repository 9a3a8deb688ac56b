#include "output/report_charts.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>

#include "base/angles.hpp"
#include "output/report_text.hpp"

namespace hedgehop::output {
namespace {

constexpr std::size_t kSamplesMax = 1500;
constexpr char kTrack[] = "#1583d0";
constexpr char kRoute[] = "#58a618";
constexpr char kLimit[] = "#b3261e";

struct Tick {
  double value;
  std::string text;
};

/// A plot in the making: x runs over the flight, 0 to 1000; y from `low` (100) to `high` (0).
class Chart {
 public:
  Chart(double length_m, double low, double high) : length_m_(length_m), low_(low), high_(high) {}

  /// One line; gaps where a value is not finite.
  void line(const std::vector<double>& along_m, const std::vector<double>& values,
            const std::string& color, double width, const char* dash = "") {
    std::string path;
    bool is_open = false;
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (!std::isfinite(values[i])) {
        is_open = false;
        continue;
      }
      path += (is_open ? "L" : "M") + x(along_m[i]) + " " + y(values[i]);
      is_open = true;
    }
    if (!path.empty()) {
      svg_ += "<path fill=\"none\" stroke=\"" + color + "\" stroke-width=\"" +
              fixed_text(width, 1) + "\"" + (*dash != '\0' ? dashes(dash) : "") + " d=\"" + path +
              "\"/>";
    }
  }
  void level(double value, const std::string& color, const char* dash) {
    svg_ += "<line x1=\"0\" x2=\"1000\" y1=\"" + y(value) + "\" y2=\"" + y(value) + "\" stroke=\"" +
            color + "\"" + dashes(dash) + "/>";
  }
  /// Between two lines; nothing where one of them is not finite.
  void band(const std::vector<double>& along_m, const std::vector<double>& lower,
            const std::vector<double>& upper, const std::string& color) {
    std::size_t first = 0;
    const auto is_known = [&](std::size_t i) {
      return std::isfinite(lower[i]) && std::isfinite(upper[i]);
    };
    while (first < lower.size()) {
      if (!is_known(first)) {
        ++first;
        continue;
      }
      std::size_t end = first;
      while (end < lower.size() && is_known(end)) {
        ++end;
      }
      std::string path;
      for (std::size_t i = first; i < end; ++i) {
        path += (path.empty() ? "M" : "L") + x(along_m[i]) + " " + y(upper[i]);
      }
      for (std::size_t i = end; i-- > first;) {
        path += "L" + x(along_m[i]) + " " + y(lower[i]);
      }
      svg_ += "<path stroke=\"none\" fill=\"" + color + "\" d=\"" + path + "Z\"/>";
      first = end;
    }
  }

  [[nodiscard]] std::string finished(const std::string& id, const std::string& title,
                                     const std::string& keys, double height_rem,
                                     const std::vector<Tick>& ticks, bool has_x_labels) const {
    std::string grid;
    std::string labels;
    for (const Tick& tick : ticks) {
      if (tick.value < low_ || tick.value > high_) {
        continue;
      }
      grid += "<line class=\"grid\" x1=\"0\" x2=\"1000\" y1=\"" + y(tick.value) + "\" y2=\"" +
              y(tick.value) + "\"/>";
      labels += "<span class=\"y\" style=\"top:" + y(tick.value) + "%\">" + tick.text + "</span>";
    }
    const double step_km = round_number_below(std::max(length_m_ / 1000.0, 1e-3) / 3.0);
    for (int k = 0; k * step_km <= length_m_ / 1000.0; ++k) {
      const std::string at = x(1000.0 * k * step_km);
      grid += "<line class=\"grid\" y1=\"0\" y2=\"100\" x1=\"" + at + "\" x2=\"" + at + "\"/>";
      if (has_x_labels) {
        labels += "<span class=\"x\" style=\"left:" + fixed_text(std::stod(at) / 10.0, 2) + "%\">" +
                  fixed_text(k * step_km, step_km < 0.1   ? 2
                                          : step_km < 1.0 ? 1
                                                          : 0) +
                  (k == 0 ? " km" : "") + "</span>";
      }
    }
    return "<figure class=\"chart\" id=\"" + id + "\"><figcaption><b>" + title + "</b>" + keys +
           "</figcaption><div class=\"plot\" style=\"height:" + fixed_text(height_rem, 1) +
           "rem\"><svg viewBox=\"0 0 1000 100\" preserveAspectRatio=\"none\" role=\"img\" "
           "aria-label=\"" +
           title + "\">" + grid + svg_ +
           "<line class=\"cursor\" x1=\"0\" x2=\"0\" y1=\"0\" y2=\"100\"/></svg>" + labels +
           "</div></figure>\n";
  }

 private:
  [[nodiscard]] std::string x(double along) const {
    return fixed_text(length_m_ > 0.0 ? 1000.0 * along / length_m_ : 0.0, 2);
  }
  [[nodiscard]] std::string y(double value) const {
    return fixed_text(std::clamp(100.0 * (high_ - value) / (high_ - low_), -400.0, 500.0), 2);
  }
  static std::string dashes(const char* dash) {
    return std::string(" stroke-dasharray=\"") + dash + "\"";
  }

  double length_m_;
  double low_;
  double high_;
  std::string svg_;
};

std::vector<Tick> round_ticks(double low, double high, int about) {
  const double step = round_number_below(std::max((high - low) / about, 1e-6));
  std::vector<Tick> ticks;
  for (double k = std::ceil(low / step); k * step <= high; ++k) {
    ticks.push_back({k * step, fixed_text(k * step, step < 1.0 ? 1 : 0)});
  }
  return ticks;
}

std::vector<Tick> compass_ticks(double low_deg, double high_deg) {
  static constexpr std::array<const char*, 8> kPoints = {"N", "NE", "E", "SE",
                                                         "S", "SW", "W", "NW"};
  const long step = high_deg - low_deg <= 200.0 ? 1 : high_deg - low_deg <= 500.0 ? 2 : 4;
  std::vector<Tick> ticks;
  for (long k = std::lround(std::ceil(low_deg / 45.0)); 45.0 * static_cast<double>(k) <= high_deg;
       ++k) {
    const long point = ((k % 8) + 8) % 8;
    if (point % step == 0) {
      ticks.push_back(
          {45.0 * static_cast<double>(k), std::string(kPoints[static_cast<std::size_t>(point)]) +
                                              " " + std::to_string(45 * point) + "°"});
    }
  }
  return ticks;
}

double greatest(const std::vector<double>& values, double at_least) {
  for (const double value : values) {
    at_least = std::fmax(at_least, value);
  }
  return at_least;
}

/// The planned altitude where the flight passes each point of the route nearest, never backwards.
void planned_altitudes(const ReportContent& content, const ReportSamples& samples,
                       std::vector<double>& along_m, std::vector<double>& altitude_m) {
  const flight::Route& route = content.plan->route_plan.route;
  const auto& points = route.guide.size() >= 2 ? route.guide : route.waypoints;
  const auto& states = content.plan->trajectory.states;
  std::size_t from = 0;
  for (const flight::Waypoint& point : points) {
    std::size_t best = from;
    double best_m2 = std::numeric_limits<double>::infinity();
    for (std::size_t i = from; i < samples.states.size(); ++i) {
      const double dx_m = states[samples.states[i]].x_m - point.x_m;
      const double dy_m = states[samples.states[i]].y_m - point.y_m;
      const double square_m2 = dx_m * dx_m + dy_m * dy_m;
      if (square_m2 < best_m2) {
        best_m2 = square_m2;
        best = i;
      }
      // Where the flight comes by again later, the nearer pass may be the wrong one.
      if (samples.along_m[i] > samples.along_m[from] + 2000.0) {
        break;
      }
    }
    from = best;
    along_m.push_back(samples.along_m[best]);
    altitude_m.push_back(point.altitude_m);
  }
}

}  // namespace

ReportSamples report_samples(const ReportContent& content) {
  const flight::Trajectory& trajectory = content.plan->trajectory;
  const auto& states = trajectory.states;
  const std::vector<double> along_m = briefing::distances_m(trajectory);
  const Headings headings = followed_headings(trajectory);
  ReportSamples samples;
  const std::size_t stride = std::max<std::size_t>(1, states.size() / kSamplesMax);
  std::size_t place = 0;
  for (std::size_t i = 0; i < states.size();
       i = i + 1 == states.size() ? states.size() : std::min(i + stride, states.size() - 1)) {
    const flight::FlightState& s = states[i];
    samples.states.push_back(i);
    samples.along_m.push_back(along_m[i]);
    samples.time_s.push_back(s.time_s);
    samples.altitude_m.push_back(s.altitude_m);
    samples.terrain_m.push_back(s.terrain_m);
    samples.surface_m.push_back(s.surface_m);
    samples.height_m.push_back(s.altitude_m - s.surface_m);
    samples.speed_mps.push_back(s.speed_mps);
    samples.climb_mps.push_back(s.climb_rate_mps);
    samples.bank_deg.push_back(degrees_from_radians(s.bank_rad));
    samples.heading_deg.push_back(headings.flown_deg[i]);
    samples.target_deg.push_back(headings.target_deg[i]);
    samples.grid_deg.push_back(
        degrees_from_radians(grid_from_true_azimuth_rad(s.heading_true_rad, s.convergence_rad)));
    const auto& places = content.costs.places;
    while (place + 1 < places.size() &&
           places[place].along_m + 0.5 * content.costs.step_m < along_m[i]) {
      ++place;
    }
    samples.cost.push_back(places.empty() ? std::numeric_limits<double>::quiet_NaN()
                                          : places[place].here.total_m());
  }
  return samples;
}

std::string profile_charts(const ReportContent& content, const ReportSamples& samples) {
  const PlanDemands demands = demands_of(content.plan->route_plan.config_text);
  const double length_m = samples.along_m.back();
  const auto raised = [&](double by_m) {
    std::vector<double> values = samples.surface_m;
    for (double& value : values) {
      value += by_m;
    }
    return values;
  };
  std::string html;
  {
    double low_m = samples.altitude_m.front();
    for (std::size_t i = 0; i < samples.states.size(); ++i) {
      low_m = std::fmin(low_m, std::fmin(samples.terrain_m[i], samples.altitude_m[i]));
    }
    std::vector<double> planned_along_m;
    std::vector<double> planned_m;
    planned_altitudes(content, samples, planned_along_m, planned_m);
    const double high_m = greatest(planned_m, greatest(samples.altitude_m, low_m)) + 15.0;
    low_m -= 15.0;
    Chart chart(length_m, low_m, high_m);
    chart.band(samples.along_m, std::vector<double>(samples.states.size(), low_m),
               samples.terrain_m, "#c9b79c");
    chart.band(samples.along_m, samples.terrain_m, samples.surface_m, "#a9cba1");
    if (demands.reference_height_m) {
      chart.line(samples.along_m, raised(*demands.reference_height_m), "#8a8a8a", 1.0, "3 3");
    }
    chart.line(planned_along_m, planned_m, kRoute, 1.6);
    chart.line(samples.along_m, samples.altitude_m, kTrack, 2.0);
    html += chart.finished(
        "chart-altitude", "altitude [m AMSL]",
        key_line(kTrack, "flown") + key_line(kRoute, "planned route") +
            (demands.reference_height_m ? key_line("#8a8a8a", "reference height", true) : "") +
            key_box("#a9cba1", "trees, buildings") + key_box("#c9b79c", "terrain"),
        13.0, round_ticks(low_m, high_m, 5), false);
  }
  {
    const double high_m = 1.1 * greatest(samples.height_m, 30.0);
    Chart chart(length_m, 0.0, high_m);
    std::string keys = key_line(kTrack, "flown");
    if (demands.required_clearance_m) {
      chart.level(*demands.required_clearance_m, kLimit, "none");
      keys += key_line(kLimit, "required clearance");
    }
    if (demands.reference_height_m) {
      chart.level(*demands.reference_height_m, "#8a8a8a", "3 3");
      keys += key_line("#8a8a8a", "reference height", true);
    }
    if (demands.ceiling_height_m && *demands.ceiling_height_m < high_m) {
      chart.level(*demands.ceiling_height_m, kLimit, "5 4");
      keys += key_line(kLimit, "ceiling", true);
    }
    chart.line(samples.along_m, samples.height_m, kTrack, 2.0);
    html += chart.finished("chart-height", "height above the surface [m]", keys, 7.0,
                           round_ticks(0.0, high_m, 4), false);
  }
  {
    double high_deg = 10.0;
    for (const double bank_deg : samples.bank_deg) {
      high_deg = std::fmax(high_deg, std::fabs(bank_deg));
    }
    std::string keys = key_line(kTrack, "right positive");
    if (demands.bank_max_rad) {
      high_deg = std::fmax(high_deg, degrees_from_radians(*demands.bank_max_rad));
      keys += key_line(kLimit, "limit", true);
    }
    high_deg *= 1.12;
    Chart chart(length_m, -high_deg, high_deg);
    chart.level(0.0, "#b0b0b0", "none");
    if (demands.bank_max_rad) {
      chart.level(degrees_from_radians(*demands.bank_max_rad), kLimit, "5 4");
      chart.level(-degrees_from_radians(*demands.bank_max_rad), kLimit, "5 4");
    }
    chart.line(samples.along_m, samples.bank_deg, kTrack, 2.0);
    html += chart.finished("chart-bank", "bank [°]", keys, 6.5, round_ticks(-high_deg, high_deg, 4),
                           false);
  }
  {
    double low_deg = std::numeric_limits<double>::infinity();
    double high_deg = -low_deg;
    for (const auto* list : {&samples.heading_deg, &samples.target_deg}) {
      for (const double value : *list) {
        low_deg = std::fmin(low_deg, value);
        high_deg = std::fmax(high_deg, value);
      }
    }
    if (!(low_deg <= high_deg)) {
      low_deg = high_deg = 0.0;
    }
    low_deg -= 8.0;
    high_deg = std::fmax(high_deg + 8.0, low_deg + 60.0);
    Chart chart(length_m, low_deg, high_deg);
    chart.line(samples.along_m, samples.target_deg, "#e08e36", 1.3);
    chart.line(samples.along_m, samples.heading_deg, kTrack, 2.0);
    html += chart.finished(
        "chart-heading", "heading from true north",
        key_line(kTrack, "flown") + key_line("#e08e36", "chosen by the local planner"), 8.0,
        compass_ticks(low_deg, high_deg), true);
  }
  return html;
}

std::string cost_chart(const ReportContent& content) {
  const auto& places = content.costs.places;
  if (places.empty()) {
    return "<p>The flight has no length.</p>\n";
  }
  struct Term {
    double flight::RouteCost::*member;
    const char* name;
    const char* color;
  };
  std::vector<Term> stack = {{&flight::RouteCost::length_m, "length", "#cfd6dd"},
                             {&flight::RouteCost::visibility_m, "visibility", "#e75263"},
                             {&flight::RouteCost::semantics_m, "land use and areas", "#e0a13a"},
                             {&flight::RouteCost::height_m, "height", "#6aa5dd"}};
  static constexpr std::array<const char*, flight::kCostTerms.size() - flight::kPaperCostTerms>
      kBeyondColors = {"#9a7bd0", "#b3263a", "#4d4d4d", "#5f9e6e"};
  for (std::size_t i = 0; i < kBeyondColors.size(); ++i) {
    const flight::CostTerm& term = flight::kCostTerms[flight::kPaperCostTerms + i];
    if (std::any_of(places.begin(), places.end(), [&](const briefing::CostPlace& place) {
          return place.here.*term.value_m > 0.0;
        })) {
      stack.push_back({term.value_m, term.words, kBeyondColors[i]});
    }
  }
  const std::size_t terms = stack.size();
  std::vector<double> along_m;
  std::vector<std::vector<double>> tops(terms + 1);
  std::vector<double> beside;
  for (const briefing::CostPlace& place : places) {
    along_m.push_back(place.along_m);
    double sum = 0.0;
    tops[0].push_back(0.0);
    for (std::size_t k = 0; k < terms; ++k) {
      sum += place.here.*stack[k].member;
      tops[k + 1].push_back(sum);
    }
    const double left = place.left.total_m();
    const double right = place.right.total_m();
    beside.push_back(std::isfinite(left) && std::isfinite(right) ? 0.5 * (left + right)
                     : std::isfinite(left)                       ? left
                                                                 : right);
  }
  // What lies beside may cost a hundred times as much for a moment; the axis follows the flight.
  std::vector<double> known;
  std::copy_if(beside.begin(), beside.end(), std::back_inserter(known),
               [](double value) { return std::isfinite(value); });
  double high = greatest(tops[terms], 2.0);
  if (!known.empty()) {
    const auto ninth = known.begin() + static_cast<std::ptrdiff_t>(known.size() * 9 / 10);
    std::nth_element(known.begin(), ninth, known.end());
    high = std::fmax(high, *ninth);
  }
  high *= 1.05;
  const double length_m = along_m.back() + 0.5 * content.costs.step_m;
  Chart chart(length_m, 0.0, high);
  std::string keys;
  for (std::size_t k = 0; k < terms; ++k) {
    chart.band(along_m, tops[k], tops[k + 1], stack[k].color);
    keys += key_box(stack[k].color, stack[k].name);
  }
  chart.line(along_m, beside, "#4a3b8f", 1.4, "5 3");
  keys +=
      key_line("#4a3b8f", fixed_text(content.beside_m, 0) + " m beside, mean of both sides", true);
  return chart.finished("chart-cost", "cost of a metre of path", keys, 10.0,
                        round_ticks(0.0, high, 5), true);
}

}  // namespace hedgehop::output

#include <CLI/CLI.hpp>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/angles.hpp"
#include "base/files.hpp"
#include "bus/map_exchange.hpp"
#include "bus_arguments.hpp"
#include "map/map_bundle.hpp"
#include "messages/map_tiles.hpp"
#include "messages/message_error.hpp"
#include "request_arguments.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

using nlohmann::ordered_json;
using SteadyTime = std::chrono::steady_clock::time_point;

constexpr double kUnset = std::numeric_limits<double>::quiet_NaN();

struct PatchArguments {
  BusArguments bus;
  double timeout_s = 10.0;
  std::int64_t id = 0;  // 0: drawn from what the thing is
  std::string label;
  std::string at;
  std::vector<std::string> outline;
  double radius_m = kUnset;
  double height_m = kUnset;
  double top_m = kUnset;
  double floor_m = kUnset;
  double floor_agl_m = kUnset;
  double ceiling_m = kUnset;
  double ceiling_agl_m = kUnset;
  bool is_soft = false;
  std::string out;
  bool is_overwriting = false;
};

std::optional<double> stated(double value) {
  return std::isnan(value) ? std::nullopt : std::optional(value);
}

double seconds_since(SteadyTime time) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - time).count();
}

map::AreaLimit limit_of(double amsl_m, double agl_m, const map::AreaLimit& otherwise) {
  if (!std::isnan(agl_m)) {
    return {agl_m, map::AreaLimit::Reference::kAboveGround};
  }
  return std::isnan(amsl_m) ? otherwise : map::AreaLimit{amsl_m, map::AreaLimit::Reference::kAmsl};
}

// The same thing has the same id, so that saying it twice does not put it there twice.
std::int64_t id_of(map::PatchKind kind, const PatchArguments& arguments) {
  std::string text = map::name_of(kind);
  const auto add = [&text](const std::string& part) { text += '\n' + part; };
  add(arguments.at);
  for (const std::string& corner : arguments.outline) {
    add(corner);
  }
  add(arguments.label);
  const std::uint64_t low = hash128(text).low;
  return static_cast<std::int64_t>(low % 900'000'000) + 100'000'000;  // nine digits, to type
}

// What map_tiler says about patches.
class PatchTalk {
 public:
  PatchTalk(const PatchArguments& arguments, Observer& observer)
      : bus_(arguments.bus.options()),
        exchange_({}, bus_),
        assembly_(exchange_),
        timeout_s_(arguments.timeout_s),
        observer_(observer) {
    bus_.subscribe<messages::MapPatchState>(
        messages::kMapPatchStateChannel,
        [this](const messages::MapPatchState& state, const messages::Stamp& stamp) {
          if (tiler_id_ == 0) {
            tiler_id_ = stamp.sender_id;
          }
          if (stamp.sender_id != tiler_id_) {
            other_ = state;
            return;
          }
          state_ = state;
        });
    bus_.subscribe<messages::MapPatch>(
        messages::kMapPatchChannel,
        [this](const messages::MapPatch& patch, const messages::Stamp&) {
          if (patch.patch_number > 0) {
            patches_[patch.patch.id] = patch;
          }
        });
    bus_.subscribe<messages::MapIndex>(
        messages::kMapIndexChannel,
        [this](const messages::MapIndex& index, const messages::Stamp& stamp) {
          index_ = index;
          if (is_wanting_map_) {
            assembly_.receive(index, stamp.sender_id);
          }
        });
  }

  void turn() {
    bus_.poll(std::min(0.05, exchange_.next_tick_s(bus_.now())));
    exchange_.tick(bus_.now());
    observer_.check_stop();
  }

  /// Turns until something is there; throws BusError with `what` after the time for it.
  template <typename IsThere>
  void wait_for(const std::string& what, const IsThere& is_there) {
    const auto begin = std::chrono::steady_clock::now();
    while (!is_there()) {
      turn();
      if (seconds_since(begin) > timeout_s_) {
        throw BusError(
            what + " within " + std::to_string(std::lround(timeout_s_)) + " s on " + bus_.url(),
            "start the services with `hedgehop serve --map MAP`, with the same "
            "--lcm-url and --channel-prefix; `hedgehop watch` shows who is there");
      }
    }
  }

  const messages::MapPatchState& state() {
    wait_for("no map_tiler heard", [this] { return state_.has_value(); });
    if (other_ && other_->base_map_hash != state_->base_map_hash) {
      throw BusError("two map_tilers with different base maps are on the bus: " +
                         state_->base_map_hash.hex() + " and " + other_->base_map_hash.hex(),
                     "stop one of them, or keep them apart with --channel-prefix");
    }
    return *state_;
  }

  geo::MapProjection projection() {
    wait_for("no map heard", [this] { return index_.has_value(); });
    const messages::MapIndex index = *index_;
    exchange_.want(index.features, "map features");
    wait_for("the map's features did not come",
             [&] { return exchange_.content(index.features.id) != nullptr; });
    map::Map map;
    try {
      messages::decode_map_features(*exchange_.content(index.features.id), index.map_hash, map);
    } catch (const messages::MessageError& error) {
      throw DataError(std::string("the map on the bus cannot be used: ") + error.what(), "");
    }
    return geo::MapProjection(map.crs_wkt);
  }

  /// The thing with its number, once it counts.
  messages::MapPatch tell(messages::MapPatch message) {
    message.base_map_hash = state().base_map_hash;
    const std::int64_t id = message.patch.id;
    patches_.erase(id);
    std::optional<SteadyTime> told;
    bool is_refused = false;
    const auto is_answered = [&] {
      if (!told || seconds_since(*told) > 0.5) {
        told = std::chrono::steady_clock::now();
        bus_.publish(messages::kMapPatchChannel, message, bus_.now());
      }
      is_refused = state_->refused_sender_id == bus_.sender_id() && state_->refused_patch_id == id;
      const auto patch = patches_.find(id);
      return is_refused ||
             (patch != patches_.end() && patch->second.is_present == message.is_present &&
              (!message.is_present || patch->second.patch == message.patch) &&
              state_->patch_number >= patch->second.patch_number);
    };
    wait_for("map_tiler did not answer", is_answered);
    if (is_refused) {
      throw DataError("map_tiler refuses " + state_->refusal, "");
    }
    return patches_.at(id);
  }

  /// All things that are there.
  std::map<std::int64_t, messages::MapPatch> list() {
    const auto is_whole = [&] {
      std::int32_t present = 0;
      for (const auto& [id, patch] : patches_) {
        present += patch.is_present && patch.base_map_hash == state_->base_map_hash ? 1 : 0;
      }
      return present == state_->patch_count;
    };
    state();
    wait_for("map_tiler did not say all patches", is_whole);
    auto result = patches_;
    std::erase_if(result, [](const auto& entry) { return !entry.second.is_present; });
    return result;
  }

  /// Waits for the whole map, named observers included.
  const bus::MapAssembly& map() {
    is_wanting_map_ = true;
    std::int64_t missing = -1;
    auto progress = std::chrono::steady_clock::now();
    while (true) {
      turn();
      if (assembly_.index()) {
        assembly_.need(assembly_.index()->hash_for(true));
      }
      assembly_.tick();
      if (assembly_.missing().empty()) {
        return assembly_;
      }
      if (!assembly_.refusal().empty()) {
        throw DataError("the map on the bus cannot be used: " + assembly_.refusal(), "");
      }
      if (const std::int64_t now = exchange_.missing_chunk_count(); now != missing) {
        missing = now;
        progress = std::chrono::steady_clock::now();
      }
      if (seconds_since(progress) > timeout_s_) {
        throw BusError("the map does not come: " + assembly_.missing(),
                       "start the services with `hedgehop serve --map MAP`");
      }
    }
  }

 private:
  bus::Bus bus_;
  bus::BlobExchange exchange_;
  bus::MapAssembly assembly_;
  const double timeout_s_;
  Observer& observer_;
  std::int64_t tiler_id_ = 0;
  std::optional<messages::MapPatchState> state_;
  std::optional<messages::MapPatchState> other_;
  std::optional<messages::MapIndex> index_;
  std::map<std::int64_t, messages::MapPatch> patches_;
  bool is_wanting_map_ = false;
};

ordered_json json_of(const messages::MapPatch& message) {
  const map::Patch& patch = message.patch;
  ordered_json json = {{"id", patch.id},
                       {"patch_number", message.patch_number},
                       {"is_present", message.is_present},
                       {"kind", map::name_of(patch.kind)},
                       {"label", patch.label}};
  const auto add = [&json](const char* key, const std::optional<double>& value) {
    if (value) {
      json[key] = *value;
    }
  };
  if (patch.kind == map::PatchKind::kArea) {
    json["is_hard"] = patch.is_hard;
    json["corners"] = patch.outline.size();
    const auto limit = [&](const char* name, const map::AreaLimit& value) {
      if (std::isfinite(value.value_m)) {
        json[std::string(name) +
             (value.reference == map::AreaLimit::Reference::kAmsl ? "_amsl_m" : "_agl_m")] =
            value.value_m;
      }
    };
    limit("floor", patch.floor);
    limit("ceiling", patch.ceiling);
  } else {
    json["x_m"] = patch.centre.x_m;
    json["y_m"] = patch.centre.y_m;
    json["radius_m"] = patch.radius_m;
    add("height_m", patch.height_m);
    add("top_amsl_m", patch.top_m);
  }
  return json;
}

void print(const ordered_json& json) {
  std::printf("%s\n", json.dump(2, ' ', false, ordered_json::error_handler_t::replace).c_str());
}

std::string line_of(const messages::MapPatch& message) {
  const map::Patch& patch = message.patch;
  char text[300];
  if (patch.kind == map::PatchKind::kArea) {
    std::snprintf(text, sizeof text, "%lld  patch %lld  %s area of %zu corners",
                  static_cast<long long>(patch.id), static_cast<long long>(message.patch_number),
                  patch.is_hard ? "no-fly" : "avoided", patch.outline.size());
  } else {
    std::snprintf(text, sizeof text, "%lld  patch %lld  %s at %.0f,%.0f, radius %.0f m",
                  static_cast<long long>(patch.id), static_cast<long long>(message.patch_number),
                  map::name_of(patch.kind), patch.centre.x_m, patch.centre.y_m, patch.radius_m);
  }
  return text + (patch.label.empty() ? "" : "  " + patch.label);
}

ExitCode tell(const Console& console, PatchTalk& talk, const messages::MapPatch& message) {
  const messages::MapPatch numbered = talk.tell(message);
  const messages::MapPatchState& state = talk.state();
  if (console.is_json) {
    ordered_json json = {{"schema", "hedgehop patch change"},
                         {"schema_version", 1},
                         {"base_map_hash", state.base_map_hash.hex()},
                         {"map_hash", state.map_hash.hex()}};
    json.update(json_of(numbered));
    print(json);
  } else if (numbered.is_present) {
    std::printf("%s\n", line_of(numbered).c_str());
  } else {
    std::printf("%lld  patch %lld  gone\n", static_cast<long long>(numbered.patch.id),
                static_cast<long long>(numbered.patch_number));
  }
  return ExitCode::kOk;
}

ExitCode add(const Console& console, const PatchArguments& arguments, map::PatchKind kind) {
  messages::MapPatch message;
  map::Patch& patch = message.patch;
  patch.kind = kind;
  patch.label = arguments.label;
  patch.id = arguments.id != 0 ? arguments.id : id_of(kind, arguments);
  std::vector<geo::GeodeticPosition> places;
  for (const std::string& text :
       kind == map::PatchKind::kArea ? arguments.outline : std::vector{arguments.at}) {
    places.push_back(
        parse_request_point(text, kind == map::PatchKind::kArea ? "--corner" : "--at").position);
  }
  if (kind == map::PatchKind::kArea) {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    patch.is_hard = !arguments.is_soft;
    using enum map::AreaLimit::Reference;
    patch.floor = limit_of(arguments.floor_m, arguments.floor_agl_m, {-kInfinity, kAboveGround});
    patch.ceiling = limit_of(arguments.ceiling_m, arguments.ceiling_agl_m, {kInfinity, kAmsl});
  } else {
    patch.radius_m = arguments.radius_m;
    patch.height_m = stated(arguments.height_m);
    patch.top_m = stated(arguments.top_m);
    if (!patch.height_m && !patch.top_m) {
      throw UsageError("an obstacle needs a height", "--height-m above ground, or --top-m AMSL");
    }
  }
  const auto observer = console.observer();
  PatchTalk talk(arguments, *observer);
  talk.state();
  const geo::MapProjection projection = talk.projection();
  for (const geo::GeodeticPosition& place : places) {
    (kind == map::PatchKind::kArea ? patch.outline.emplace_back() : patch.centre) =
        projection.to_map(place);
  }
  return tell(console, talk, message);
}

ExitCode remove(const Console& console, const PatchArguments& arguments) {
  messages::MapPatch message;
  message.patch.id = arguments.id;
  message.is_present = false;
  const auto observer = console.observer();
  PatchTalk talk(arguments, *observer);
  return tell(console, talk, message);
}

ExitCode list(const Console& console, const PatchArguments& arguments) {
  const auto observer = console.observer();
  PatchTalk talk(arguments, *observer);
  const auto patches = talk.list();
  const messages::MapPatchState& state = talk.state();
  if (console.is_json) {
    ordered_json json = {{"schema", "hedgehop patch list"},
                         {"schema_version", 1},
                         {"base_map_hash", state.base_map_hash.hex()},
                         {"map_hash", state.map_hash.hex()},
                         {"patch_number", state.patch_number},
                         {"patches", ordered_json::array()}};
    for (const auto& [id, patch] : patches) {
      json["patches"].push_back(json_of(patch));
    }
    print(json);
    return ExitCode::kOk;
  }
  std::printf("base map %s, patch %lld, %zu things\n", state.base_map_hash.hex().c_str(),
              static_cast<long long>(state.patch_number), patches.size());
  for (const auto& [id, patch] : patches) {
    std::printf("%s\n", line_of(patch).c_str());
  }
  return ExitCode::kOk;
}

ExitCode fetch_map(const Console& console, const PatchArguments& arguments) {
  StagedFolder folder(arguments.out, map::kMapManifestFile, arguments.is_overwriting);
  const auto observer = console.observer();
  PatchTalk talk(arguments, *observer);
  const messages::MapPatchState before = talk.state();
  const bus::MapAssembly& assembly = talk.map();
  const auto map = assembly.map();
  const ordered_json provenance = {{"base_map_hash", before.base_map_hash.hex()},
                                   {"patch_number", assembly.patch_number()}};
  map::write_map_bundle(*map, provenance.dump(), folder.path(), observer.get());
  if (const auto with_threats = assembly.map_with_threats()) {
    std::vector<map::NamedBand> bands;
    for (const map::HeightLayer& threat : with_threats->threats) {
      bands.push_back({threat.name, &threat.height_m});
    }
    map::write_height_bands(*map, bands, folder.path() / map::kThreatsFile, observer.get());
  }
  folder.commit();
  if (console.is_json) {
    ordered_json json = {
        {"schema", "hedgehop patch map"}, {"schema_version", 1}, {"map", arguments.out}};
    json["map_hash"] = map->hash.hex();
    json.update(provenance);
    print(json);
  } else {
    std::printf("map %s, patch %lld, in %s\n", map->hash.hex().c_str(),
                static_cast<long long>(assembly.patch_number()), arguments.out.c_str());
  }
  return ExitCode::kOk;
}

}  // namespace

void add_patch_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand(
      "patch", "Put obstacles, observers and areas over the map on the bus, and take them away");
  verb->require_subcommand(1);
  verb->footer(
      "map_tiler gives each change a number and puts the changed map on the bus; plans under way\n"
      "are made again on it, and every plan says which number it knows.\n"
      "Examples:\n"
      "  hedgehop patch add obstacle --at 49.951,11.462 --radius-m 30 --height-m 80 --label crane\n"
      "  hedgehop patch add threat --at 49.96,11.47 --range-m 4000 --mast-height-m 3\n"
      "  hedgehop patch add area --corner 49.94,11.44 --corner 49.95,11.46 --corner 49.94,11.47\n"
      "  hedgehop patch list\n"
      "  hedgehop patch remove 480117252");
  const auto arguments = std::make_shared<PatchArguments>();
  const auto finish = [&console, arguments](CLI::App& sub, auto action) {
    arguments->bus.add_to(sub);
    sub.add_option("--timeout-s", arguments->timeout_s, "Longest wait for map_tiler (default 10)")
        ->check(CLI::Range(0.1, 86400.0));
    add_common_options(sub, console);
    sub.callback([&console, arguments, action] {
      console.action = [&console, arguments, action] { return action(console, *arguments); };
    });
  };
  const auto add_name = [arguments](CLI::App& sub) {
    sub.add_option("--id", arguments->id,
                   "Number of the thing; the same id again changes it (default: drawn from place "
                   "and label)")
        ->check(CLI::Range(std::int64_t{1}, std::numeric_limits<std::int64_t>::max()));
    sub.add_option("--label", arguments->label, "What people call it, at most 60 bytes");
  };

  auto* add_verb = verb->add_subcommand("add", "Something appears, or changes");
  add_verb->require_subcommand(1);
  add_verb->footer(
      "Example:\n  hedgehop patch add obstacle --at 49.951,11.462 --radius-m 30 "
      "--height-m 80 --label crane");

  auto* obstacle = add_verb->add_subcommand("obstacle", "Something to collide with");
  obstacle->footer(
      "Every cell that the cylinder touches is raised to its top, as when a map is prepared with\n"
      "it; radius and height hold all errors and margins.\n"
      "Example:\n"
      "  hedgehop patch add obstacle --at 49.951,11.462 --radius-m 30 --height-m 80");
  obstacle->add_option("--at", arguments->at, "Its place, LAT,LON")->required();
  obstacle->add_option("--radius-m", arguments->radius_m, "Of the cylinder that holds it")
      ->required()
      ->check(CLI::Range(0.0, 200000.0));
  auto* height = obstacle->add_option("--height-m", arguments->height_m, "Its top above the ground")
                     ->check(CLI::Range(0.0, 20000.0));
  obstacle->add_option("--top-m", arguments->top_m, "Its top above the sea")
      ->check(CLI::Range(-20000.0, 20000.0))
      ->excludes(height);
  add_name(*obstacle);
  finish(*obstacle, [](const Console& c, const PatchArguments& a) {
    return add(c, a, map::PatchKind::kObstacle);
  });

  auto* threat = add_verb->add_subcommand("threat", "Somebody who looks");
  threat->footer(
      "Where the observer sees an aircraft at the map's reference height, visibility becomes 1.\n"
      "Example:\n"
      "  hedgehop patch add threat --at 49.96,11.47 --range-m 4000 --mast-height-m 3");
  threat->add_option("--at", arguments->at, "Its place, LAT,LON")->required();
  threat->add_option("--range-m", arguments->radius_m, "How far it sees")
      ->required()
      ->check(CLI::Range(1.0, 200000.0));
  threat->add_option("--mast-height-m", arguments->height_m, "Its eye above the ground")
      ->required()
      ->check(CLI::Range(0.0, 10000.0));
  add_name(*threat);
  finish(*threat, [](const Console& c, const PatchArguments& a) {
    return add(c, a, map::PatchKind::kThreat);
  });

  auto* area = add_verb->add_subcommand("area", "Air that must not be entered, or costs");
  area->footer(
      "Example:\n"
      "  hedgehop patch add area --corner 49.94,11.44 --corner 49.95,11.46 --corner 49.94,11.47 "
      "--ceiling-m 900");
  area->add_option("--corner", arguments->outline, "LAT,LON, 3 to 64 of them, in order")
      ->required()
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  area->add_flag("--soft", arguments->is_soft, "It may be entered, but costs");
  auto* floor = area->add_option("--floor-m", arguments->floor_m, "Lower end above the sea");
  area->add_option("--floor-agl-m", arguments->floor_agl_m,
                   "Lower end above the ground (default: from the ground on)")
      ->excludes(floor);
  auto* ceiling = area->add_option("--ceiling-m", arguments->ceiling_m, "Upper end above the sea");
  area->add_option("--ceiling-agl-m", arguments->ceiling_agl_m,
                   "Upper end above the ground (default: without end)")
      ->excludes(ceiling);
  add_name(*area);
  finish(*area, [](const Console& c, const PatchArguments& a) {
    return add(c, a, map::PatchKind::kArea);
  });

  auto* remove_verb = verb->add_subcommand("remove", "Something has gone");
  remove_verb->footer("Example:\n  hedgehop patch remove 480117252");
  remove_verb->add_option("id", arguments->id, "Its number, see `hedgehop patch list`")
      ->required()
      ->check(CLI::Range(std::int64_t{1}, std::numeric_limits<std::int64_t>::max()));
  finish(*remove_verb, remove);

  auto* list_verb = verb->add_subcommand("list", "What is there");
  list_verb->footer("Example:\n  hedgehop patch list --json");
  finish(*list_verb, list);

  auto* map_verb =
      verb->add_subcommand("map", "Write the map on the bus, patches in it, as a bundle");
  map_verb->footer(
      "For `hedgehop verify`, `report` and `plan` on what is on the bus now.\n"
      "Example:\n"
      "  hedgehop patch map --out map_with_patches");
  map_verb->add_option("--out", arguments->out, "Folder to write the map to")->required();
  map_verb->add_flag("--overwrite", arguments->is_overwriting, "Replace an existing map in --out");
  finish(*map_verb, fetch_map);
}

}  // namespace hedgehop::cli

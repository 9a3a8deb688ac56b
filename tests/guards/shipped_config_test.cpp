// Every file in config/ is read by its reader, and each of its keys is guarded: misspelt, removed,
// duplicated and ill-typed variants are refused with a ConfigError that names file and line.

#include "base/shipped_config.hpp"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <functional>
#include <gtest/gtest.h>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <yaml-cpp/yaml.h>

#include "base/config_reader.hpp"
#include "base/errors.hpp"
#include "briefing/cost_profile.hpp"
#include "briefing/flight_legs.hpp"
#include "briefing/manoeuvres.hpp"
#include "command_model/command_model.hpp"
#include "evaluation/clearance_risk.hpp"
#include "evaluation/flight_evaluation.hpp"
#include "evaluation/framework_comparison.hpp"
#include "evaluation/local_flights.hpp"
#include "evaluation/optimality_evaluation.hpp"
#include "evaluation/protection_evaluation.hpp"
#include "evaluation/random_evaluation.hpp"
#include "evaluation/reaction_evaluation.hpp"
#include "evaluation/replanning_evaluation.hpp"
#include "evaluation/sensitivity.hpp"
#include "evaluation/tuning.hpp"
#include "evaluation/verifier_evaluation.hpp"
#include "fetch/fetch_options.hpp"
#include "map_sources/vector_mapping.hpp"
#include "output/exports.hpp"
#include "planning/alternatives.hpp"
#include "planning/planning.hpp"
#include "preparation/prepare.hpp"
#include "services/command_model/command_model_service.hpp"
#include "services/flight_logger/flight_logger_service.hpp"
#include "services/local_planner/local_planner_service.hpp"
#include "services/map_tiler/map_tiler_service.hpp"
#include "services/shared/planner_desk.hpp"

namespace hedgehop {
namespace {

/// Reads a whole document and throws ConfigError if anything about it is wrong.
using Read = std::function<void(const std::string& text, const std::string& name)>;

struct Guarded {
  Read read;
  /// Keys that a document may leave out, as dotted paths.
  std::set<std::string> optional;
};

void read_vehicle_file(const std::string& text, const std::string& name) {
  ConfigReader reader = ConfigReader::from_text(text, name);
  command_model::read_vehicle(reader);
}

void read_fetch_file(const std::string& text, const std::string& name) {
  ConfigReader reader = ConfigReader::from_text(text, name);
  fetch::FetchOptions::read(reader);
}

void read_prepare_file(const std::string& text, const std::string& name) {
  ConfigReader reader = ConfigReader::from_text(text, name);
  preparation::PrepareOptions::read(reader);
}

void read_evaluation_file(const std::string& text, const std::string& name) {
  ConfigReader reader = ConfigReader::from_text(text, name);
  ConfigReader random = reader.required_section("random");
  evaluation::read_random_options(random);
  ConfigReader protection = reader.required_section("protection");
  evaluation::read_protection_options(protection);
  ConfigReader routes = reader.required_section("routes");
  evaluation::read_route_rules(routes);
  ConfigReader table2 = reader.required_section("table2");
  evaluation::read_table2_options(table2);
  ConfigReader table3 = reader.required_section("table3");
  evaluation::read_framework_options(table3);
  ConfigReader sensitivity = reader.required_section("sensitivity");
  evaluation::read_sensitivity_options(sensitivity);
  ConfigReader tune = reader.required_section("tune");
  evaluation::read_tune_options(tune);
  ConfigReader safety = reader.required_section("local_safety");
  evaluation::read_local_safety_options(safety);
  ConfigReader optimality = reader.required_section("optimality");
  evaluation::read_optimality_config(optimality);
  ConfigReader reaction = reader.required_section("reaction");
  evaluation::read_reaction_evaluation_options(reaction);
  ConfigReader replanning = reader.required_section("replanning");
  evaluation::read_replanning_options(replanning);
  ConfigReader verifier = reader.required_section("verifier");
  evaluation::read_verifier_options(verifier);
  ConfigReader bus = reader.required_section("bus");
  evaluation::read_bus_options(bus);
  ConfigReader flight = reader.required_section("flight");
  evaluation::read_flight_options(flight);
  reader.finish();
}

void read_report_file(const std::string& text, const std::string& name) {
  ConfigReader reader = ConfigReader::from_text(text, name);
  ConfigReader legs = reader.required_section("legs");
  briefing::read_leg_options(legs);
  ConfigReader manoeuvres = reader.required_section("manoeuvres");
  briefing::read_manoeuvre_options(manoeuvres);
  ConfigReader costs = reader.required_section("costs");
  briefing::read_cost_options(costs);
  reader.finish();
}

void read_rotor_file(const std::string& text, const std::string& name) {
  ConfigReader reader = ConfigReader::from_text(text, name);
  command_model::read_rotor_parameters(reader);
}

void read_uncertainty_file(const std::string& text, const std::string& name) {
  ConfigReader reader = ConfigReader::from_text(text, name);
  evaluation::read_uncertainty_options(reader);
}

void read_alternatives_file(const std::string& text, const std::string& name) {
  ConfigReader reader = ConfigReader::from_text(text, name);
  planning::read_alternative_options(reader);
}

void read_export_file(const std::string& text, const std::string& name) {
  ConfigReader reader = ConfigReader::from_text(text, name);
  output::read_export_options(reader);
}

// The readers of services take the whole document.
template <typename Options>
Read read_whole(Options (*read)(ConfigReader)) {
  return [read](const std::string& text, const std::string& name) {
    read(ConfigReader::from_text(text, name));
  };
}

// A planning config names its vehicle; what is read has the vehicle's file as a section in its
// place.
void read_planning_file(const std::string& text, const std::string& name) {
  ConfigReader whole = ConfigReader::from_text(text, name);
  std::string complete = text;
  std::string vehicle(shipped_config("vehicles/ec135.yaml"));
  if (whole.has("vehicle_file")) {
    vehicle = shipped_config(whole.required_string("vehicle_file"));
    complete.insert(
        complete.starts_with("vehicle_file:") ? 0 : complete.find("\nvehicle_file:") + 1, "# ");
  }
  complete += "\nvehicle:\n  " + std::regex_replace(vehicle, std::regex("\n"), "\n  ") + "\n";
  planning::read_planning_config(complete, name);
}

/// The reader of each shipped file: a file in config/ must have an entry here.
const Guarded* guarded(const std::string& file) {
  static const std::map<std::string, Guarded> kFiles{
      {"planning.yaml", {read_planning_file, {"vehicle_file"}}},
      {"prepare.yaml", {read_prepare_file, {}}},
      {"alternatives.yaml", {read_alternatives_file, {}}},
      {"evaluation.yaml", {read_evaluation_file, {}}},
      {"export.yaml", {read_export_file, {}}},
      {"report.yaml", {read_report_file, {}}},
      {"uncertainty.yaml", {read_uncertainty_file, {}}},
      {"fetch.yaml", {read_fetch_file, {}}},
      {"map_tiler.yaml", {read_whole(services::read_map_tiler_options), {}}},
      {"global_planner.yaml", {read_whole(services::read_planner_options), {}}},
      {"local_planner.yaml", {read_whole(services::LocalPlannerService::read_options), {}}},
      {"command_model.yaml", {read_whole(services::read_command_model_options), {}}},
      {"rotor_plant.yaml", {read_rotor_file, {}}},
      {"flight_logger.yaml", {read_whole(services::read_flight_logger_options), {}}},
  };
  if (file.starts_with("mappings/")) {
    static const Guarded kMapping{[](const std::string& text, const std::string& name) {
                                    map_sources::VectorMapping::read(text, name);
                                  },
                                  {"rules.1.default_height_m", "rules.2.default_height_m",
                                   "rules.3.default_height_m", "rules.4.default_height_m"}};
    return &kMapping;
  }
  if (file.starts_with("vehicles/")) {
    static const Guarded kVehicle{read_vehicle_file, {"power"}};
    return &kVehicle;
  }
  const auto found = kFiles.find(file);
  return found == kFiles.end() ? nullptr : &found->second;
}

/// One key of a document: where it stands and what its value is.
struct Key {
  std::vector<std::string> path;  // words, and numbers for entries of lists
  YAML::Mark mark;
  bool is_in_flow = false;  // {key: value} on one line

  [[nodiscard]] const std::string& word() const { return path.back(); }
  [[nodiscard]] std::string dotted() const {
    std::string text;
    for (const std::string& step : path) {
      text += (text.empty() ? "" : ".") + step;
    }
    return text;
  }
};

void collect(const YAML::Node& node, std::vector<std::string> path, std::vector<Key>& keys) {
  if (node.IsMap()) {
    for (const auto& entry : node) {
      Key key;
      key.path = path;
      key.path.push_back(entry.first.Scalar());
      key.mark = entry.first.Mark();
      key.is_in_flow = node.Style() == YAML::EmitterStyle::Flow;
      keys.push_back(key);
      collect(entry.second, key.path, keys);
    }
  } else if (node.IsSequence()) {
    for (std::size_t i = 0; i < node.size(); ++i) {
      path.push_back(std::to_string(i));
      collect(node[i], path, keys);
      path.pop_back();
    }
  }
}

std::vector<Key> keys_of(const std::string& text) {
  std::vector<Key> keys;
  collect(YAML::Load(text), {}, keys);
  return keys;
}

/// The mapping that holds the key, in a document of its own.
YAML::Node holder(YAML::Node root, const Key& key) {
  YAML::Node node;
  node.reset(root);
  for (std::size_t i = 0; i + 1 < key.path.size(); ++i) {
    if (node.IsSequence()) {
      node.reset(node[std::stoul(key.path[i])]);
    } else {
      node.reset(node[key.path[i]]);
    }
  }
  return node;
}

std::size_t offset_of(const std::string& text, const YAML::Mark& mark) {
  std::size_t offset = 0;
  for (int line = 0; line < mark.line; ++line) {
    offset = text.find('\n', offset) + 1;
  }
  return offset + static_cast<std::size_t>(mark.column);
}

/// The key with its middle letter doubled; a unit at its end stays as it is.
std::string misspelt(const std::string& word) {
  const std::size_t middle = (word.size() - 1) / 3;
  return word.substr(0, middle + 1) + word[middle] + word.substr(middle + 1);
}

struct Refusal {
  int line = 0;  // 0: accepted, -1: refused without a place
  std::string what;
};

Refusal refusal(const Read& read, const std::string& text, const std::string& name) {
  try {
    read(text, name);
  } catch (const ConfigError& error) {
    const std::string what = error.what();
    if (!what.starts_with(name + ":")) {
      return {-1, what};
    }
    const int line = std::atoi(what.c_str() + name.size() + 1);
    return {line > 0 ? line : -1, what + " (" + error.hint() + ")"};
  } catch (const std::exception& error) {
    return {-1, std::string("not a ConfigError: ") + error.what()};
  }
  return {};
}

std::string text_of(const YAML::Node& node) {
  YAML::Emitter out;
  out << node;
  return std::string(out.c_str()) + "\n";
}

class ShippedConfig : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    guarded_ = guarded(GetParam());
    ASSERT_NE(guarded_, nullptr) << "config/" << GetParam()
                                 << " has no reader in tests/guards/shipped_config_test.cpp";
    text_ = shipped_config(GetParam());
    keys_ = keys_of(text_);
    ASSERT_FALSE(keys_.empty());
  }
  [[nodiscard]] bool is_optional(const Key& key) const {
    return guarded_->optional.contains(key.dotted());
  }
  const Guarded* guarded_ = nullptr;
  std::string text_;
  std::vector<Key> keys_;
};

TEST_P(ShippedConfig, IsReadAsItIsShipped) {
  const Refusal result = refusal(guarded_->read, text_, GetParam());
  EXPECT_EQ(result.line, 0) << result.what;
}

TEST_P(ShippedConfig, IsTheFileInTheSourceTree) {
  std::ifstream file("config/" + GetParam());
  std::ostringstream content;
  content << file.rdbuf();
  EXPECT_EQ(content.str(), text_) << "the embedded copy is stale";
}

TEST_P(ShippedConfig, RefusesEachMisspeltKeyWithFileAndLine) {
  for (const Key& key : keys_) {
    std::string text = text_;
    text.replace(offset_of(text, key.mark), key.word().size(), misspelt(key.word()));
    const Refusal result = refusal(guarded_->read, text, GetParam());
    EXPECT_GT(result.line, 0) << key.dotted() << ": " << result.what;
    // the wrong word itself, or the right one as missing
    EXPECT_TRUE(result.what.find("'" + misspelt(key.word())) != std::string::npos ||
                result.what.find(misspelt(key.word()) + "'") != std::string::npos ||
                result.what.find(key.word() + "'") != std::string::npos)
        << key.dotted() << ": " << result.what;
  }
}

TEST_P(ShippedConfig, RefusesEachRemovedKeyWithFileAndLine) {
  for (const Key& key : keys_) {
    if (is_optional(key)) {
      continue;
    }
    YAML::Node root = YAML::Load(text_);
    holder(root, key).remove(key.word());
    const Refusal result = refusal(guarded_->read, text_of(root), GetParam());
    EXPECT_GT(result.line, 0) << key.dotted() << ": " << result.what;
    EXPECT_NE(result.what.find(key.word()), std::string::npos)
        << key.dotted() << ": " << result.what;
  }
}

TEST_P(ShippedConfig, RefusesEachDuplicatedKeyInTheLineOfTheSecond) {
  for (const Key& key : keys_) {
    std::string text = text_;
    const std::string again =
        key.is_in_flow
            ? key.word() + ": 1, "
            : key.word() + ": 1\n" + std::string(static_cast<std::size_t>(key.mark.column), ' ');
    text.insert(offset_of(text, key.mark), again);
    const Refusal result = refusal(guarded_->read, text, GetParam());
    EXPECT_EQ(result.line, key.mark.line + (key.is_in_flow ? 1 : 2))
        << key.dotted() << ": " << result.what;
    EXPECT_NE(result.what.find("duplicate key '" + key.word() + "'"), std::string::npos)
        << result.what;
  }
}

TEST_P(ShippedConfig, RefusesAnUnknownKeyBesideEachKeyInItsLine) {
  for (const Key& key : keys_) {
    std::string text = text_;
    const std::string more =
        key.is_in_flow
            ? "no_such_key: 1, "
            : "no_such_key: 1\n" + std::string(static_cast<std::size_t>(key.mark.column), ' ');
    text.insert(offset_of(text, key.mark), more);
    const Refusal result = refusal(guarded_->read, text, GetParam());
    EXPECT_EQ(result.line, key.mark.line + 1) << key.dotted() << ": " << result.what;
    EXPECT_NE(result.what.find("no_such_key'"), std::string::npos) << result.what;
  }
}

TEST_P(ShippedConfig, RefusesEachIllTypedValueInItsLine) {
  for (const Key& key : keys_) {
    const YAML::Node value = holder(YAML::Load(text_), key)[key.word()];
    std::vector<std::string> wrong{"{wrong: 1}", "[[1], [2]]", "~"};
    double number = 0.0;
    bool flag = false;
    if (value.IsMap() || value.IsSequence()) {
      wrong.emplace_back("7");
      wrong.emplace_back("word");
    } else if (YAML::convert<double>::decode(value, number)) {
      wrong.insert(wrong.end(), {"word", "true", ".nan", ".inf", "-.inf", "12 m", "''"});
    } else if (YAML::convert<bool>::decode(value, flag)) {
      wrong.insert(wrong.end(), {"3", "maybe"});
    }
    for (const std::string& replacement : wrong) {
      YAML::Node root = YAML::Load(text_);
      holder(root, key)[key.word()] = YAML::Load(replacement);
      const std::string text = text_of(root);
      const Refusal result = refusal(guarded_->read, text, GetParam());
      EXPECT_GT(result.line, 0) << key.dotted() << " = " << replacement << ": " << result.what;
      // In the line of the key, or in that of the wrong value when it spans more than one.
      int line = 0;
      for (const Key& candidate : keys_of(text)) {
        if (candidate.path == key.path) {
          line = candidate.mark.line + 1;
        }
      }
      EXPECT_GE(result.line, line) << key.dotted() << " = " << replacement << ": " << result.what;
      EXPECT_LE(result.line, line + 2)
          << key.dotted() << " = " << replacement << ": " << result.what;
    }
  }
}

// The same text as a user's own file, which replaces shipped values key by key. Lists are replaced
// as wholes, so keys inside them are left to the reader.

constexpr char kUsersFile[] = "mine.yaml";

bool is_inside_list(const Key& key) {
  return std::any_of(key.path.begin(), key.path.end(),
                     [](const std::string& step) { return std::isdigit(step[0]) != 0; });
}

TEST_P(ShippedConfig, AsUsersFileRefusesEachMisspeltKeyInItsLineAndNamesTheRightOne) {
  const Read overlay = [&](const std::string& text, const std::string& name) {
    overlay_config(text_, "shipped", text, name);
  };
  EXPECT_EQ(refusal(overlay, text_, kUsersFile).line, 0);
  for (const Key& key : keys_) {
    if (is_inside_list(key)) {
      continue;
    }
    std::string text = text_;
    text.replace(offset_of(text, key.mark), key.word().size(), misspelt(key.word()));
    const Refusal result = refusal(overlay, text, kUsersFile);
    EXPECT_EQ(result.line, key.mark.line + 1) << key.dotted() << ": " << result.what;
    EXPECT_NE(result.what.find("unknown key '" + misspelt(key.word()) + "'"), std::string::npos)
        << result.what;
    EXPECT_NE(result.what.find("did you mean '" + key.word() + "'?"), std::string::npos)
        << result.what;
  }
}

TEST_P(ShippedConfig, AsUsersFileRefusesEachIllTypedValueInItsLine) {
  for (const Key& key : keys_) {
    if (is_inside_list(key)) {
      continue;
    }
    const YAML::Node value = holder(YAML::Load(text_), key)[key.word()];
    std::vector<std::string> wrong;
    double number = 0.0;
    bool flag = false;
    if (value.IsMap() || value.IsSequence()) {
      wrong = {"7", "word", "~"};
    } else if (YAML::convert<double>::decode(value, number)) {
      wrong = {"word", "true", ".nan", ".inf", "12 m", "[3]", "~", "{a: 3}"};
    } else if (YAML::convert<bool>::decode(value, flag)) {
      wrong = {"3", "maybe", "[true]"};
    } else {
      wrong = {"[word]", "{a: word}", "~"};
    }
    for (const std::string& replacement : wrong) {
      // The key alone, below its sections, after a line of remarks.
      std::string text = "# mine\n";
      for (std::size_t depth = 0; depth < key.path.size(); ++depth) {
        text += std::string(2 * depth, ' ') + key.path[depth] + ":" +
                (depth + 1 < key.path.size() ? "\n" : " " + replacement + "\n");
      }
      const Refusal result = refusal(
          [&](const std::string& mine, const std::string& name) {
            guarded_->read(overlay_config(text_, "shipped", mine, name), "effective");
          },
          text, kUsersFile);
      EXPECT_EQ(result.line, static_cast<int>(key.path.size()) + 1) << text << result.what;
      EXPECT_NE(result.what.find("'" + key.word() + "' must be"), std::string::npos) << result.what;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Config, ShippedConfig, testing::ValuesIn(shipped_config_names()));

TEST(ShippedConfigNames, AreAllYamlFilesBelowConfig) {
  const std::vector<std::string> names = shipped_config_names();
  std::set<std::string> on_disk;
  for (const auto& entry : std::filesystem::recursive_directory_iterator("config")) {
    if (entry.is_regular_file()) {
      on_disk.insert(std::filesystem::relative(entry.path(), "config").generic_string());
    }
  }
  EXPECT_EQ(std::set<std::string>(names.begin(), names.end()), on_disk);
}

}  // namespace
}  // namespace hedgehop

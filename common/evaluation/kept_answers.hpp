#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace hedgehop::evaluation {

/// Answers of a long evaluation, one a problem, each in a file of its own that is written whole or
/// not at all: an interrupted run goes on where it was.
class KeptAnswers {
 public:
  /// `identity` is all that the answers depend on besides the problem's number; they lie in a
  /// folder named by its hash. An empty `folder` keeps nothing.
  /// @throws SystemFailure  if the folder cannot be made.
  KeptAnswers(const std::filesystem::path& folder, const nlohmann::ordered_json& identity);

  /// Nothing if there is no such file, or if it belongs to another question or is damaged.
  [[nodiscard]] std::optional<nlohmann::ordered_json> find(std::int64_t problem) const;
  void keep(std::int64_t problem, nlohmann::ordered_json answer) const;

 private:
  [[nodiscard]] std::filesystem::path file_of(std::int64_t problem) const;

  std::string question_;
  std::filesystem::path folder_;  // empty: nothing is kept
};

}  // namespace hedgehop::evaluation

#pragma once

#include <filesystem>
#include <map>
#include <set>
#include <string>

#include "base/observer.hpp"
#include "fetch/fetch_options.hpp"

namespace hedgehop::fetch {

/// What is to be fetched and how it is told from anything else.
struct Order {
  std::string url;
  std::filesystem::path target;
  std::int64_t bytes_max = 0;
  std::vector<long> absent_statuses;
  ChecksumKind checksum = ChecksumKind::kNone;
  std::string checksum_url;
  std::string sha256;  // known beforehand; may be empty
};

struct Delivery {
  enum class Result : std::uint8_t { kWhole, kAbsent, kMissing };
  Result result = Result::kMissing;
  std::string last_modified = {};
  std::string trouble = {};
};

/// Speaks HTTP, one request at a time. fetch.hpp says what a download does and leaves behind.
class Downloader {
 public:
  Downloader(const Politeness& politeness, Observer& observer);
  ~Downloader();
  Downloader(const Downloader&) = delete;
  Downloader& operator=(const Downloader&) = delete;

  Delivery download(const Order& order);

  class Sink;  // for the callbacks of libcurl

 private:
  struct Answer;

  Answer ask(const std::string& url, Sink& sink, const std::string& resume_header_value,
             std::int64_t from);
  void wait(double seconds, const std::string& why);
  Delivery transfer(const Order& order);
  std::string wrong_content(const Order& order, std::string& trouble);
  bool fetch_text(const std::string& url, std::string& text, std::string& trouble);

  Politeness politeness_;
  Observer& observer_;
  void* curl_ = nullptr;
  std::map<std::string, double> last_request_s_;  // by host
  std::set<std::string> unreachable_;             // hosts
};

}  // namespace hedgehop::fetch

#include "fetch/download.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <curl/curl.h>
#include <memory>
#include <openssl/evp.h>
#include <thread>
#include <unistd.h>

#include "base/errors.hpp"
#include "base/files.hpp"
#include "base/hash.hpp"

namespace hedgehop::fetch {
namespace {

namespace fs = std::filesystem;
using std::chrono::steady_clock;

constexpr std::int64_t kTextMax = 65536;
constexpr int kRedirectsMax = 5;

double now_s() {
  return std::chrono::duration<double>(steady_clock::now().time_since_epoch()).count();
}

fs::path part_of(const fs::path& target) { return target.string() + ".part"; }
/// What tells whether the server still has the file that the part is of.
fs::path tag_of(const fs::path& target) { return target.string() + ".part.tag"; }

void remove_part(const fs::path& target) {
  std::error_code ignored;
  fs::remove(part_of(target), ignored);
  fs::remove(tag_of(target), ignored);
}

std::string host_of(const std::string& url) {
  const std::size_t begin = url.find("://") + 3;
  return url.substr(begin, url.find_first_of("/?#", begin) - begin);
}

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) {
    return static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
  });
  return text;
}

std::string md5_hex_of_file(const fs::path& path) {
  const std::string text = read_file(path);
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned int length = 0;
  if (EVP_Digest(text.data(), text.size(), digest.data(), &length, EVP_md5(), nullptr) != 1) {
    throw SystemFailure("MD5 cannot be computed on this system",
                        "use a source with another checksum");
  }
  std::string hex;
  for (unsigned int i = 0; i < length; ++i) {
    std::array<char, 3> two{};
    std::snprintf(two.data(), two.size(), "%02x", digest[i]);
    hex += two.data();
  }
  return hex;
}

bool may_pass(long status) {
  return status == 408 || status == 425 || status == 429 || (status >= 500 && status <= 599);
}

bool may_pass(CURLcode code) {
  switch (code) {
    case CURLE_COULDNT_RESOLVE_HOST:
    case CURLE_COULDNT_RESOLVE_PROXY:
    case CURLE_COULDNT_CONNECT:
    case CURLE_OPERATION_TIMEDOUT:
    case CURLE_PARTIAL_FILE:
    case CURLE_GOT_NOTHING:
    case CURLE_RECV_ERROR:
    case CURLE_SEND_ERROR:
    case CURLE_SSL_CONNECT_ERROR:
    case CURLE_HTTP2:
    case CURLE_HTTP2_STREAM:
      return true;
    default:
      return false;
  }
}

bool is_unreachable(CURLcode code) {
  return code == CURLE_COULDNT_RESOLVE_HOST || code == CURLE_COULDNT_RESOLVE_PROXY ||
         code == CURLE_COULDNT_CONNECT;
}

}  // namespace

struct Downloader::Answer {
  CURLcode code = CURLE_OK;
  long status = 0;
  double retry_after_s = 0.0;
  std::string trouble;  // empty: all came
};

/// Where the body of an answer goes, once its status is known.
class Downloader::Sink {
 public:
  Sink(std::FILE* file, std::string* text, std::int64_t from, std::int64_t bytes_max)
      : file_(file), text_(text), from_(from), bytes_max_(bytes_max) {}

  bool write(const char* data, std::size_t size) {
    if (size == 0) {
      return true;
    }
    if (static_cast<std::int64_t>(size) > bytes_max_ - at_) {
      trouble_ = "it is larger than bytes_max, " + std::to_string(bytes_max_) + " bytes";
      return false;
    }
    if (file_ != nullptr && std::fwrite(data, 1, size, file_) != size) {
      throw_is_due_ = true;
      return false;
    }
    if (text_ != nullptr) {
      text_->append(data, size);
    }
    at_ += static_cast<std::int64_t>(size);
    return true;
  }

  // The first line and the headers of an answer, each redirect's too.
  void header(std::string line) {
    while (!line.empty() && (line.back() == '\r' || line.back() == '\n')) {
      line.pop_back();
    }
    if (line.starts_with("HTTP/")) {
      const std::size_t space = line.find(' ');
      status_ = space == std::string::npos ? 0 : std::atol(line.c_str() + space + 1);
      etag.clear();
      last_modified.clear();
      return;
    }
    const std::size_t colon = line.find(':');
    if (colon == std::string::npos) {
      return;
    }
    const std::string name = lower(line.substr(0, colon));
    const std::size_t value_at = line.find_first_not_of(" \t", colon + 1);
    const std::string value = value_at == std::string::npos ? "" : line.substr(value_at);
    if (name == "etag") {
      etag = value;
    } else if (name == "last-modified") {
      last_modified = value;
    }
  }

  /// Called before the first byte of a body: whether it is the file, and from where.
  bool begin() {
    has_begun_ = true;
    if (status_ == 206 && from_ > 0) {
      at_ = from_;
      return true;
    }
    at_ = 0;
    if (status_ == 200 && file_ != nullptr) {
      std::rewind(file_);  // all of it comes, whatever was there
      if (::ftruncate(::fileno(file_), 0) != 0) {
        throw_is_due_ = true;
        return false;
      }
    }
    return status_ == 200;
  }

  [[nodiscard]] bool has_begun() const { return has_begun_; }
  [[nodiscard]] std::int64_t at() const { return at_; }
  [[nodiscard]] const std::string& trouble() const { return trouble_; }
  [[nodiscard]] bool is_disk_full() const { return throw_is_due_; }

  std::string etag;
  std::string last_modified;
  Observer* observer = nullptr;
  std::string stage;

 private:
  std::FILE* file_;
  std::string* text_;
  std::int64_t from_;
  std::int64_t bytes_max_;
  std::int64_t at_ = 0;
  long status_ = 0;
  bool has_begun_ = false;
  bool throw_is_due_ = false;
  std::string trouble_;
};

namespace {

std::size_t on_body(char* data, std::size_t size, std::size_t count, void* context) {
  auto* sink = static_cast<Downloader::Sink*>(context);
  if (!sink->has_begun() && !sink->begin()) {
    return 0;
  }
  return sink->write(data, size * count) ? size * count : 0;
}

std::size_t on_header(char* data, std::size_t size, std::size_t count, void* context) {
  static_cast<Downloader::Sink*>(context)->header(std::string(data, size * count));
  return size * count;
}

int on_progress(void* context, curl_off_t total, curl_off_t done, curl_off_t, curl_off_t) {
  const auto* sink = static_cast<Downloader::Sink*>(context);
  const double before = static_cast<double>(sink->at()) - static_cast<double>(done);
  if (total > 0) {
    sink->observer->progress(sink->stage, static_cast<double>(sink->at()),
                             std::max(before, 0.0) + static_cast<double>(total));
  }
  return sink->observer->stop_requested() ? 1 : 0;
}

}  // namespace

Downloader::Downloader(const Politeness& politeness, Observer& observer)
    : politeness_(politeness), observer_(observer) {
  static const bool is_ready = ::curl_global_init(CURL_GLOBAL_DEFAULT) == CURLE_OK;
  curl_ = is_ready ? ::curl_easy_init() : nullptr;
  if (curl_ == nullptr) {
    throw SystemFailure("libcurl cannot be used");
  }
}

Downloader::~Downloader() { ::curl_easy_cleanup(curl_); }

void Downloader::wait(double seconds, const std::string& why) {
  const double end_s = now_s() + seconds;
  if (seconds >= 3.0 && !why.empty()) {
    observer_.note(why + "; waiting " + std::to_string(static_cast<int>(seconds + 0.5)) + " s");
  }
  while (true) {
    observer_.check_stop();
    const double left_s = end_s - now_s();
    if (left_s <= 0.0) {
      return;
    }
    std::this_thread::sleep_for(std::chrono::duration<double>(std::min(left_s, 0.1)));
  }
}

Downloader::Answer Downloader::ask(const std::string& url, Sink& sink,
                                   const std::string& resume_header_value, std::int64_t from) {
  const std::string host = host_of(url);
  if (const auto last = last_request_s_.find(host); last != last_request_s_.end()) {
    wait(last->second + politeness_.pause_s - now_s(), "");
  }
  sink.observer = &observer_;
  ::curl_easy_reset(curl_);
  std::array<char, CURL_ERROR_SIZE> error{};
  ::curl_easy_setopt(curl_, CURLOPT_ERRORBUFFER, error.data());
  ::curl_easy_setopt(curl_, CURLOPT_URL, url.c_str());
  ::curl_easy_setopt(curl_, CURLOPT_PROTOCOLS_STR, "http,https");
  ::curl_easy_setopt(curl_, CURLOPT_REDIR_PROTOCOLS_STR, "http,https");
  ::curl_easy_setopt(curl_, CURLOPT_FOLLOWLOCATION, 1L);
  ::curl_easy_setopt(curl_, CURLOPT_MAXREDIRS, static_cast<long>(kRedirectsMax));
  ::curl_easy_setopt(curl_, CURLOPT_USERAGENT, politeness_.user_agent.c_str());
  ::curl_easy_setopt(curl_, CURLOPT_NOSIGNAL, 1L);
  ::curl_easy_setopt(curl_, CURLOPT_CONNECTTIMEOUT_MS,
                     static_cast<long>(1000.0 * politeness_.connect_timeout_s));
  ::curl_easy_setopt(curl_, CURLOPT_LOW_SPEED_LIMIT, 1L);
  ::curl_easy_setopt(curl_, CURLOPT_LOW_SPEED_TIME, static_cast<long>(politeness_.stall_timeout_s));
  ::curl_easy_setopt(curl_, CURLOPT_WRITEFUNCTION, &on_body);
  ::curl_easy_setopt(curl_, CURLOPT_WRITEDATA, &sink);
  ::curl_easy_setopt(curl_, CURLOPT_HEADERFUNCTION, &on_header);
  ::curl_easy_setopt(curl_, CURLOPT_HEADERDATA, &sink);
  ::curl_easy_setopt(curl_, CURLOPT_NOPROGRESS, 0L);
  ::curl_easy_setopt(curl_, CURLOPT_XFERINFOFUNCTION, &on_progress);
  ::curl_easy_setopt(curl_, CURLOPT_XFERINFODATA, &sink);
  ::curl_slist* headers = nullptr;
  const std::string range = std::to_string(from) + "-";
  if (from > 0) {
    ::curl_easy_setopt(curl_, CURLOPT_RANGE, range.c_str());
    headers = ::curl_slist_append(nullptr, ("If-Range: " + resume_header_value).c_str());
    ::curl_easy_setopt(curl_, CURLOPT_HTTPHEADER, headers);
  }
  Answer answer;
  answer.code = ::curl_easy_perform(curl_);
  ::curl_slist_free_all(headers);
  last_request_s_[host] = now_s();
  ::curl_easy_getinfo(curl_, CURLINFO_RESPONSE_CODE, &answer.status);
  curl_off_t retry_after_s = 0;
  ::curl_easy_getinfo(curl_, CURLINFO_RETRY_AFTER, &retry_after_s);
  answer.retry_after_s = static_cast<double>(retry_after_s);
  observer_.check_stop();
  if (sink.is_disk_full()) {
    throw SystemFailure("what is fetched cannot be written: " + std::string(std::strerror(errno)),
                        "make room and run the same command again: it goes on where it ended");
  }
  if (!sink.trouble().empty()) {
    answer.trouble = sink.trouble();
  } else if (answer.status >= 300 || (answer.status != 0 && answer.status < 200)) {
    answer.trouble = "the server answers with status " + std::to_string(answer.status);
  } else if (answer.code != CURLE_OK) {
    answer.trouble = error[0] != '\0' ? error.data() : ::curl_easy_strerror(answer.code);
  } else if (answer.status != 200 && answer.status != 206) {
    answer.trouble = "the server answers with status " + std::to_string(answer.status);
  }
  return answer;
}

Delivery Downloader::download(const Order& order) {
  const std::string host = host_of(order.url);
  if (unreachable_.contains(host)) {
    return {.trouble = host + " cannot be reached"};
  }
  // Wrong content is fetched a second time, in case that it was damaged on its way.
  for (int attempt = 0;; ++attempt) {
    Delivery delivery = transfer(order);
    if (delivery.result != Delivery::Result::kWhole) {
      return delivery;
    }
    std::string trouble;
    const std::string wrong = wrong_content(order, trouble);
    if (!trouble.empty()) {  // what it should be cannot be told: the part waits for the next time
      return {.trouble = trouble};
    }
    if (wrong.empty()) {
      std::error_code error;
      fs::rename(part_of(order.target), order.target, error);
      if (error) {
        throw SystemFailure("cannot name " + order.target.string() + ": " + error.message());
      }
      remove_part(order.target);
      return delivery;
    }
    remove_part(order.target);
    if (attempt > 0) {
      return {.trouble = wrong};
    }
    observer_.note(order.target.filename().string() + ": " + wrong + "; fetching it again");
  }
}

Delivery Downloader::transfer(const Order& order) {
  const fs::path part = part_of(order.target);
  double back_off_s = politeness_.back_off_s;
  int failures = 0;
  while (true) {
    // Only what is known to be the beginning of the same file is built upon.
    std::string validator;
    std::int64_t from = 0;
    std::error_code error;
    if (fs::exists(tag_of(order.target), error) && fs::exists(part, error)) {
      const std::string tag = read_file(tag_of(order.target));
      const std::size_t end = tag.find('\n');
      if (end != std::string::npos && tag.substr(0, end) == order.url) {
        validator = tag.substr(end + 1);
        from = static_cast<std::int64_t>(fs::file_size(part, error));
      }
    }
    if (validator.empty() || validator.find_first_of("\r\n") != std::string::npos) {
      from = 0;
      remove_part(order.target);
    }
    const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(
        std::fopen(part.c_str(), from > 0 ? "r+b" : "wb"), &std::fclose);
    if (file == nullptr || std::fseek(file.get(), 0, SEEK_END) != 0) {
      throw SystemFailure("cannot write " + part.string() + ": " + std::strerror(errno),
                          "choose another --out, or make room");
    }
    Sink sink(file.get(), nullptr, from, order.bytes_max);
    sink.stage = "fetching " + order.target.filename().string();
    Answer answer;
    const auto keep =
        [&] {  // for the next time, if the server can tell whether it is the same file
          const std::string tag =
              !sink.etag.empty() && !sink.etag.starts_with("W/") ? sink.etag : sink.last_modified;
          std::fflush(file.get());
          if (sink.has_begun() && sink.at() > 0 && !tag.empty()) {
            write_file_atomically(tag_of(order.target), order.url + "\n" + tag);
          } else if (sink.has_begun() || from == 0) {
            remove_part(order.target);
          }
        };
    try {
      answer = ask(order.url, sink, validator, from);
    } catch (const UserError&) {
      keep();
      throw;
    }
    if (answer.trouble.empty()) {
      if (std::fflush(file.get()) != 0 || ::fsync(::fileno(file.get())) != 0) {
        throw SystemFailure("cannot write " + part.string() + ": " + std::strerror(errno),
                            "make room and run the same command again");
      }
      if (!sink.has_begun()) {
        return {.trouble = "the server answers with an empty file"};
      }
      return {Delivery::Result::kWhole, sink.last_modified, ""};
    }
    if (answer.status == 416) {  // what is there is no beginning of what the server has
      remove_part(order.target);
    } else {
      keep();
    }
    if (std::find(order.absent_statuses.begin(), order.absent_statuses.end(), answer.status) !=
        order.absent_statuses.end()) {
      remove_part(order.target);
      return {.result = Delivery::Result::kAbsent};
    }
    const bool is_cut = answer.status == 200 || answer.status == 206;
    const bool is_worth_trying =
        answer.status == 416 || may_pass(answer.status) ||
        ((answer.status == 0 || is_cut) && may_pass(answer.code) && sink.trouble().empty());
    const bool has_grown = is_cut && sink.at() > from;
    failures = has_grown ? 0 : failures + 1;
    if (!is_worth_trying || failures > politeness_.retries_max) {
      if (is_unreachable(answer.code)) {
        unreachable_.insert(host_of(order.url));
      }
      return {.trouble = answer.trouble};
    }
    if (answer.retry_after_s > politeness_.retry_after_max_s) {
      return {.trouble = answer.trouble + " and asks for a pause of " +
                         std::to_string(static_cast<long>(answer.retry_after_s)) + " s"};
    }
    if (has_grown) {
      back_off_s = politeness_.back_off_s;
    }
    wait(answer.retry_after_s > 0.0 ? answer.retry_after_s : back_off_s,
         order.target.filename().string() + ": " + answer.trouble);
    back_off_s = std::min(2.0 * back_off_s, politeness_.back_off_max_s);
  }
}

bool Downloader::fetch_text(const std::string& url, std::string& text, std::string& trouble) {
  double back_off_s = politeness_.back_off_s;
  for (int failures = 0;;) {
    text.clear();
    Sink sink(nullptr, &text, 0, kTextMax);
    sink.stage = "fetching a checksum";
    const Answer answer = ask(url, sink, "", 0);
    if (answer.trouble.empty()) {
      return true;
    }
    if (!(may_pass(answer.status) || may_pass(answer.code)) || !sink.trouble().empty() ||
        ++failures > politeness_.retries_max ||
        answer.retry_after_s > politeness_.retry_after_max_s) {
      trouble = "its checksum " + url + ": " + answer.trouble;
      return false;
    }
    wait(answer.retry_after_s > 0.0 ? answer.retry_after_s : back_off_s, url);
    back_off_s = std::min(2.0 * back_off_s, politeness_.back_off_max_s);
  }
}

// What is wrong with the part, empty if nothing is; `trouble` if it cannot be told.
std::string Downloader::wrong_content(const Order& order, std::string& trouble) {
  const fs::path part = part_of(order.target);
  // Portals of hotels and servers that are down like to answer with a page.
  {
    const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(part.c_str(), "rb"),
                                                               &std::fclose);
    std::array<char, 256> head{};
    const std::size_t size =
        file == nullptr ? 0 : std::fread(head.data(), 1, head.size(), file.get());
    std::string text = lower(std::string(head.data(), size));
    text.erase(0, std::min(text.size(), text.find_first_not_of(" \t\r\n")));
    if (text.starts_with("<!doctype html") || text.starts_with("<html")) {
      return "the server answers with a web page instead of the file";
    }
  }
  if (!order.sha256.empty() && sha256_hex_of_file(part.string()) != order.sha256) {
    return "its SHA-256 is not that of the configuration";
  }
  if (order.checksum == ChecksumKind::kNone) {
    return {};
  }
  std::string text;
  if (!fetch_text(order.checksum_url, text, trouble)) {
    return {};
  }
  const std::size_t digits = order.checksum == ChecksumKind::kMd5 ? 32 : 64;
  const std::string wanted = lower(text.substr(0, text.find_first_of(" \t\r\n*")));
  if (wanted.size() != digits ||
      wanted.find_first_not_of("0123456789abcdef") != std::string::npos) {
    trouble = "its checksum " + order.checksum_url + " is no checksum";
    return {};
  }
  const std::string found = order.checksum == ChecksumKind::kMd5
                                ? md5_hex_of_file(part)
                                : sha256_hex_of_file(part.string());
  return found == wanted ? "" : "its checksum is " + found + ", the server says " + wanted;
}

}  // namespace hedgehop::fetch

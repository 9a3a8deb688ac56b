#include "evaluation/child_run.hpp"

#include <atomic>
#include <cstdlib>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stdexcept>
#include <string>
#include <unistd.h>
#include <vector>

#include "base/errors.hpp"

namespace hedgehop::evaluation {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string run(const std::function<void(const SendMessage&)>& work,
                std::vector<std::string>& messages, double cpu_s_max = 60.0) {
  return run_in_child(
      work, [&](std::string_view message) { messages.emplace_back(message); }, cpu_s_max,
      SilentObserver());
}

TEST(RunInChild, HandsOverEachMessageInOrderWhateverItsBytes) {
  std::vector<std::string> messages;
  const std::string zeros(300000, '\0');
  EXPECT_EQ(run(
                [&](const SendMessage& send) {
                  send("one");
                  send("");
                  send(zeros);
                },
                messages),
            "");
  EXPECT_THAT(messages, ElementsAre("one", "", zeros));
}

TEST(RunInChild, ChangesNothingHere) {
  int value = 1;
  std::vector<std::string> messages;
  run(
      [&](const SendMessage& send) {
        value = 2;
        send(std::to_string(value));
      },
      messages);
  EXPECT_EQ(value, 1);
  EXPECT_THAT(messages, ElementsAre("2"));
}

TEST(RunInChild, KeepsWhatWasSentBeforeItAborted) {
  std::vector<std::string> messages;
  const std::string ending = run(
      [](const SendMessage& send) {
        send("before");
        std::abort();
      },
      messages);
  EXPECT_THAT(ending, HasSubstr("aborted"));
  EXPECT_THAT(messages, ElementsAre("before"));
}

TEST(RunInChild, TellsWhatAnExceptionSaid) {
  std::vector<std::string> messages;
  EXPECT_THAT(
      run([](const SendMessage&) { throw std::runtime_error("no memory for this"); }, messages),
      HasSubstr("no memory for this"));
  EXPECT_THAT(run([](const SendMessage&) { throw 7; }, messages), HasSubstr("failed"));
  EXPECT_THAT(run([](const SendMessage&) { ::_exit(3); }, messages), HasSubstr("without a word"));
}

TEST(RunInChild, EndsWorkThatDoesNotStop) {
  std::vector<std::string> messages;
  const std::string ending = run(
      [](const SendMessage& send) {
        send("begun");
        std::atomic<bool> is_forever{true};
        while (is_forever) {
        }
      },
      messages, 1.0);
  EXPECT_THAT(ending, HasSubstr("did not stop"));
  EXPECT_THAT(messages, ElementsAre("begun"));
}

class StoppingObserver final : public Observer {
 public:
  void progress(std::string_view, double, double) override {}
  void note(std::string_view) override {}
  [[nodiscard]] bool stop_requested() const override { return ++asked_ > 2; }

 private:
  mutable int asked_ = 0;
};

TEST(RunInChild, IsGoneWhenTheUserStopsIt) {
  pid_t child = 0;
  EXPECT_THROW(run_in_child(
                   [](const SendMessage& send) {
                     const pid_t self = ::getpid();
                     send({reinterpret_cast<const char*>(&self), sizeof self});
                     ::pause();
                   },
                   [&](std::string_view message) {
                     std::copy(message.begin(), message.end(), reinterpret_cast<char*>(&child));
                   },
                   60.0, StoppingObserver()),
               Interrupted);
  ASSERT_GT(child, 0);
  EXPECT_NE(::kill(child, 0), 0);
}

}  // namespace
}  // namespace hedgehop::evaluation

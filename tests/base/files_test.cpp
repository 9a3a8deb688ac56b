#include "base/files.hpp"

#include <filesystem>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <string>

#include "base/errors.hpp"
#include "support/temporary_folder.hpp"

namespace hedgehop {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

std::size_t entries_in(const fs::path& folder) {
  return static_cast<std::size_t>(
      std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
}

void write(const fs::path& path, std::string_view text) { write_file_atomically(path, text); }

class Files : public ::testing::Test {
 protected:
  test::TemporaryFolder temporary_;
  fs::path folder_ = temporary_.path();
};

TEST_F(Files, WrittenBytesAreReadBackWithNulAndAll) {
  const std::string text("a\0b\r\n\xff", 6);
  write(folder_ / "x", text);
  EXPECT_EQ(read_file(folder_ / "x"), text);
  write(folder_ / "x", "");
  EXPECT_EQ(read_file(folder_ / "x"), "");
  EXPECT_EQ(entries_in(folder_), 1U) << "no temporary file stays";
}

TEST_F(Files, MissingFilesAndFoldersAreBadDataByName) {
  try {
    read_file(folder_ / "none.yaml");
    FAIL();
  } catch (const DataError& error) {
    EXPECT_THAT(error.what(), HasSubstr("none.yaml: no such file"));
  }
  try {
    read_file(folder_);
    FAIL();
  } catch (const DataError& error) {
    EXPECT_THAT(error.what(), HasSubstr("is a folder"));
  }
}

TEST_F(Files, FailedWriteLeavesTheOldFileAndNothingElse) {
  fs::create_directory(folder_ / "target");
  EXPECT_THROW(write(folder_ / "target", "x"), SystemFailure) << "a folder stands in the way";
  EXPECT_EQ(entries_in(folder_), 1U);
  EXPECT_THROW(write(folder_ / "no" / "x", "x"), SystemFailure);
  EXPECT_EQ(entries_in(folder_), 1U);
}

TEST_F(Files, StagedFolderAppearsOnlyWhenComplete) {
  const fs::path target = folder_ / "bundle";
  {
    StagedFolder staged(target, "manifest.json", false);
    fs::create_directory(staged.path() / "layers");
    write(staged.path() / "layers" / "a", "1");
    write(staged.path() / "manifest.json", "{}");
    EXPECT_FALSE(fs::exists(target));
    staged.commit();
    EXPECT_TRUE(fs::exists(target));
  }
  EXPECT_EQ(read_file(target / "layers" / "a"), "1");
  EXPECT_EQ(entries_in(folder_), 1U);
}

TEST_F(Files, StagedFolderThatIsNotCommittedLeavesNothing) {
  {
    StagedFolder staged(folder_ / "bundle", "manifest.json", false);
    write(staged.path() / "manifest.json", "{}");
  }
  EXPECT_EQ(entries_in(folder_), 0U);
}

TEST_F(Files, ExistingFolderIsKeptUnlessOverwritingIsAskedFor) {
  const fs::path target = folder_ / "bundle";
  fs::create_directory(target);
  write(target / "manifest.json", "old");
  try {
    StagedFolder staged(target, "manifest.json", false);
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_THAT(error.what(), HasSubstr("bundle exists already"));
    EXPECT_THAT(error.hint(), HasSubstr("--overwrite"));
  }
  {
    StagedFolder abandoned(target, "manifest.json", true);
    write(abandoned.path() / "manifest.json", "new");
  }
  EXPECT_EQ(read_file(target / "manifest.json"), "old");
  StagedFolder staged(target, "manifest.json", true);
  write(staged.path() / "manifest.json", "new");
  staged.commit();
  EXPECT_EQ(read_file(target / "manifest.json"), "new");
  EXPECT_EQ(entries_in(folder_), 1U);
}

TEST_F(Files, ForeignFolderIsNeverReplaced) {
  const fs::path target = folder_ / "photographs";
  fs::create_directory(target);
  write(target / "a.jpg", "x");
  EXPECT_THROW(StagedFolder(target, "manifest.json", true), UsageError);
  write(folder_ / "file", "x");
  EXPECT_THROW(StagedFolder(folder_ / "file", "manifest.json", true), UsageError);
  EXPECT_EQ(read_file(target / "a.jpg"), "x");
}

TEST_F(Files, MissingParentIsNamedAndTrailingSlashIsIgnored) {
  EXPECT_THROW(StagedFolder(folder_ / "no" / "bundle", "m", false), UsageError);
  {
    StagedFolder staged(folder_ / "bundle/", "m", false);
    write(staged.path() / "m", "x");
    staged.commit();
  }
  EXPECT_EQ(read_file(folder_ / "bundle" / "m"), "x");
}

}  // namespace
}  // namespace hedgehop

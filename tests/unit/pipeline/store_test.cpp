// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/pipeline/store.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "planner/base/hash.hpp"
#include "tests/unit/pipeline/worker.hpp"

namespace asbuilt {
namespace {

const std::string kKey(64, 'a');

TEST(Store, gives_back_what_it_was_given) {
  const test::TemporaryFolder folder;
  Store store(folder.path);
  EXPECT_FALSE(store.find(kKey));
  const std::string bytes("a\0b", 3), hash = sha256_hex(bytes);
  store.keep_object(hash, bytes);
  store.keep(kKey, {true, hash, {{Note::Level::warning, "n.code", "text", "where"}}, {}});
  const auto found = Store(folder.path).find(kKey);
  ASSERT_TRUE(found);
  EXPECT_TRUE(found->is_done);
  EXPECT_EQ(found->notes.at(0).code, "n.code");
  EXPECT_EQ(store.load(found->artefact_hash), bytes);
}

TEST(Store, keeps_refusals) {
  const test::TemporaryFolder folder;
  Store store(folder.path);
  store.keep(kKey, {false, "", {}, {{.code = "fit.tangent", .measured = 3, .limit = 10}}});
  const auto found = store.find(kKey);
  ASSERT_TRUE(found);
  EXPECT_FALSE(found->is_done);
  EXPECT_EQ(found->refusals.at(0).code, "fit.tangent");
  EXPECT_EQ(found->refusals.at(0).limit, 10);
}

TEST(Store, a_damaged_artefact_is_none) {
  const test::TemporaryFolder folder;
  Store store(folder.path);
  const std::string bytes = "the bytes of an artefact", hash = sha256_hex(bytes);
  store.keep_object(hash, bytes);
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder.path))
    if (entry.is_regular_file()) std::ofstream(entry.path(), std::ios::binary) << "the bytes of an artefacT";
  EXPECT_FALSE(store.load(hash));
}

TEST(Store, a_damaged_key_is_none) {
  const test::TemporaryFolder folder;
  Store store(folder.path);
  store.keep(kKey, {false, "", {}, {{.code = "x"}}});
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder.path))
    if (entry.is_regular_file()) std::filesystem::resize_file(entry.path(), 5);
  EXPECT_FALSE(store.find(kKey));
}

TEST(Store, a_key_whose_artefact_is_gone_is_none) {
  const test::TemporaryFolder folder;
  Store store(folder.path);
  store.keep(kKey, {true, sha256_hex("never kept"), {}, {}});
  EXPECT_FALSE(store.find(kKey));
}

TEST(Store, pruning_keeps_what_the_keys_lead_to_and_what_is_young) {
  const test::TemporaryFolder folder;
  Store store(folder.path);
  const std::string old_key(64, 'b'), one = "one", two = "two";
  for (const auto& [key, bytes] : {std::pair{kKey, one}, {old_key, two}}) store.keep_object(sha256_hex(bytes), bytes), store.keep(key, {true, sha256_hex(bytes), {}, {}});
  EXPECT_EQ(store.prune({kKey}, 1), 0u);
  EXPECT_EQ(store.prune({kKey}, 0), 2u);
  EXPECT_TRUE(store.find(kKey));
  EXPECT_EQ(store.load(sha256_hex(one)), one);
  EXPECT_FALSE(store.find(old_key));
  EXPECT_FALSE(store.load(sha256_hex(two)));
}

}  // namespace
}  // namespace asbuilt

// SPDX-License-Identifier: GPL-3.0-or-later
// KUKA RSI: one <Rob> element after the other as they went over the wire, with or without an element around them all.
#include <fmt/format.h>
#include <tinyxml2.h>

#include <cmath>
#include <cstring>

#include "planner/io/robot_log_read.hpp"
#include "planner/io/text_scan.hpp"

namespace asbuilt::robot_log_detail {
namespace {

constexpr std::size_t kPacketBytesMax = 65536;

bool number_of(const char* text, double& value) {
  if (!text) return false;
  while (*text == ' ' || *text == '\t' || *text == '\n' || *text == '\r') ++text;
  std::string s(text, strnlen(text, 64));
  while (!s.empty() && static_cast<unsigned char>(s.back()) <= ' ') s.pop_back();
  if (const std::size_t at = s.find(','); at != std::string::npos) s[at] = '.';
  return text_scan::parse_number(s, value) && std::isfinite(value);
}

bool numbers_of(const tinyxml2::XMLElement* e, const std::array<const char*, 6>& names, std::array<double, 6>& values) {
  if (!e) return false;
  for (std::size_t i = 0; i < 6; ++i)
    if (!number_of(e->Attribute(names[i]), values[i])) return false;
  return true;
}

bool is_on(const char* text) {
  double value = 0;
  if (!text) return false;
  if (number_of(text, value)) return value > 0.5;
  return std::strcmp(text, "TRUE") == 0 || std::strcmp(text, "true") == 0;
}

}  // namespace

Result<RawLog> read_rsi(std::string_view bytes, const std::string& name, const std::string& flash) {
  RawLog log;
  log.wrap_s = 1;
  std::string clean;
  if (bytes.find('\0') != std::string_view::npos) {
    clean.reserve(bytes.size());
    for (const char c : bytes)
      if (c) clean += c;
      else ++log.facts.nul_count;
    bytes = clean;
  }
  const std::string channel = flash.substr(0, flash.find('.'));
  const std::string attribute = flash.find('.') == std::string::npos ? "" : flash.substr(flash.find('.') + 1);
  std::size_t packets = 0, with_pose = 0, with_joints = 0, first_broken = 0;
  std::array<bool, 6> is_moving{};
  std::size_t at = 0;
  tinyxml2::XMLDocument document;
  while ((at = bytes.find("<Rob", at)) != std::string_view::npos) {
    const char after = at + 4 < bytes.size() ? bytes[at + 4] : ' ';
    if (after != ' ' && after != '>' && after != '\t' && after != '\r' && after != '\n') {
      at += 4;  // <Robot..>, <Robs>
      continue;
    }
    ++packets;
    const std::size_t next = bytes.find("<Rob", at + 4), end = bytes.find("</Rob>", at);
    const bool is_whole = end != std::string_view::npos && end - at < kPacketBytesMax && (next == std::string_view::npos || end < next);
    const std::size_t begin = at;
    at += 4;
    RawSample sample;
    bool is_good = is_whole;
    if (is_whole) {
      at = end + 6;
      is_good = document.Parse(bytes.data() + begin, end + 6 - begin) == tinyxml2::XML_SUCCESS && document.RootElement() != nullptr;
    }
    if (is_good) {
      const tinyxml2::XMLElement* root = document.RootElement();
      const tinyxml2::XMLElement* ipoc = root->FirstChildElement("IPOC");
      double clock = 0;
      is_good = ipoc && number_of(ipoc->GetText(), clock);
      sample.clock_s = clock / 1000;
      std::array<double, 6> v{};
      const tinyxml2::XMLElement *pose = root->FirstChildElement("RIst"), *joints = root->FirstChildElement("AIPos");
      if (pose && is_good) {
        is_good = numbers_of(pose, {"X", "Y", "Z", "A", "B", "C"}, v);
        if (is_good) {
          ++with_pose;
          sample.value.T_base_tool = {quat_from_zyx(rad_from_deg(v[3]), rad_from_deg(v[4]), rad_from_deg(v[5])), Vec3(v[0], v[1], v[2])};
        }
      }
      if (joints && is_good) {
        is_good = numbers_of(joints, {"A1", "A2", "A3", "A4", "A5", "A6"}, v);
        if (is_good) {
          ++with_joints;
          sample.value.joints_deg = v;
          for (std::size_t i = 0; i < 6; ++i) is_moving[i] = is_moving[i] || v[i] != 0;
        }
      }
      if (is_good && !flash.empty())
        if (const tinyxml2::XMLElement* e = root->FirstChildElement(channel.c_str())) {
          const char* text = attribute.empty() ? e->GetText() : e->Attribute(attribute.c_str());
          log.facts.has_flash_channel = log.facts.has_flash_channel || text != nullptr;
          sample.flash = is_on(text);
        }
    }
    if (is_good) {
      log.samples.push_back(sample);
    } else if (log.facts.broken_count++ == 0) {
      first_broken = packets;
    }
  }
  const auto refused = [&](const char* code, const std::string& message, double measured = 0, double limit = 0, const char* unit = "") {
    return refuse({.code = code, .where = name, .message = message, .measured = measured, .limit = limit, .unit = unit, .stage = "input"});
  };
  if (packets == 0)
    return refused("input.log_format", "found XML without a packet <Rob ..> .. </Rob>, allowed RSI packets as the controller sends them, or a table");
  if (log.facts.broken_count > 2 && static_cast<double>(log.facts.broken_count) > 0.01 * static_cast<double>(packets))
    return refused("input.log_value", fmt::format("found {} of {} packets broken (the first is packet {}), allowed 1 %: IPOC, RIst or AIPos do not hold numbers", log.facts.broken_count, packets, first_broken),
                   100.0 * static_cast<double>(log.facts.broken_count) / static_cast<double>(packets), 1, "%");
  log.facts.has_poses = with_pose > 0 && with_pose == log.samples.size();
  log.facts.has_joints = with_joints > 0 && with_joints == log.samples.size();
  if (!log.samples.empty() && !log.facts.has_poses && !log.facts.has_joints)
    return refused("input.log_columns", "found packets without RIst and AIPos (or only some with them), allowed actual poses or joints in every packet; commanded ones (RSol) are not where the robot was");
  if (log.facts.has_joints) {
    log.facts.joints_source = "AIPos";
    log.facts.has_joint = is_moving;
    for (std::size_t i = 0; i < 6; ++i)
      if (!is_moving[i]) log.facts.absent_columns.push_back("AIPos.A" + std::to_string(i + 1));
  }
  if (!flash.empty() && !log.facts.has_flash_channel)
    return refused("input.log_channel", "found no channel " + text_scan::shown_word(flash) + " in the packets, allowed a tag (FLASH) or a tag and its attribute (Digin.o1)");
  return log;
}

}  // namespace asbuilt::robot_log_detail

#include "tests/support/hostile_texts.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include <chrono>
#include <cstdio>
#include <map>
#include <memory>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "lumifold/v1/access.pb.h"
#include "lumifold/v1/farm.pb.h"
#include "lumifold/v1/worker.pb.h"
#include "proto/rpc/credentials.h"

namespace lumifold {
namespace {

namespace pb = google::protobuf;

constexpr std::chrono::seconds kDeadline(60);
constexpr int kMaxDepth = 4;
/// Of a stream without an end the first answer is enough.
constexpr int kMaxAnswers = 1;

std::vector<std::string> Tricks() {
  const std::string hash(64, 'a');
  return {"",
          ".",
          "..",
          "../../../../../../etc/passwd",
          "/etc/passwd",
          "/tmp/lumifold-canary",
          "../../../../../../tmp/lumifold-canary",
          "..\\..\\..\\windows\\win.ini",
          "C:\\windows\\win.ini",
          "\\\\server\\share",
          "%2e%2e%2f%2e%2e%2fetc%2fpasswd",
          "....//....//etc/passwd",
          "file:///etc/passwd",
          std::string("j-1\0/../../etc/passwd", 21),
          std::string("\0", 1),
          absl::StrCat(hash, "/../../ledger.db"),
          absl::StrCat("../assets/", hash),
          hash,
          std::string(64, 'A'),
          "/dev/zero",
          "/proc/self/environ",
          "~/.ssh/id_rsa",
          "$(touch /tmp/lumifold-canary)",
          "`touch /tmp/lumifold-canary`",
          "'; DROP TABLE jobs; --",
          "x\nevent=forged identity=\"root\"",
          "\x1b[2J\x1b[31m",
          "\xe2\x80\xae"
          "fdp.exe",                               // right to left
          "\xef\xbc\x8e\xef\xbc\x8e\xef\xbc\x8f",  // full-width ../
          "\xe2\x88\x95\xe2\x80\xa6",              // division slash, ellipsis
          std::string(255, 'x'),
          std::string(4096, '/'),
          std::string(100'000, 'x'),
          std::string(3 << 20, '.'),
          "%s%n%x",
          "w-9223372036854775808",
          "-1"};
}

/// Texts that are not UTF-8: overlong encodings of "../", half a surrogate pair, a lone byte.
std::vector<std::string> BadUtf8() {
  return {"\xc0\xae\xc0\xae\xc0\xaf", "\xed\xa0\x80", "\xff",
          "a\x80"
          "b",
          "\xf8\x88\x80\x80\x80"};
}

/// Fills all fields: texts with `text`, numbers with one, messages with one of each.
void Fill(pb::Message* message, const std::string& text, int depth) {
  const pb::Descriptor* descriptor = message->GetDescriptor();
  const pb::Reflection* reflection = message->GetReflection();
  for (int i = 0; i < descriptor->field_count(); ++i) {
    const pb::FieldDescriptor* field = descriptor->field(i);
    if (field->containing_oneof() != nullptr && field->index_in_oneof() > 0) continue;
    const bool repeated = field->is_repeated();
    if (field->cpp_type() == pb::FieldDescriptor::CPPTYPE_STRING) {
      repeated ? reflection->AddString(message, field, text) : reflection->SetString(message, field, text);
    } else if (field->cpp_type() == pb::FieldDescriptor::CPPTYPE_MESSAGE && depth < kMaxDepth) {
      Fill(repeated ? reflection->AddMessage(message, field) : reflection->MutableMessage(message, field),
           text, depth + 1);
    } else if (field->cpp_type() == pb::FieldDescriptor::CPPTYPE_INT32 && !repeated) {
      reflection->SetInt32(message, field, 1);
    }
  }
}

/// The message with all its texts replaced, as bytes: what is not UTF-8 cannot be set otherwise. The stand-in
/// has the length of the text.
std::string WithText(std::string bytes, const std::string& stand_in, const std::string& text) {
  for (size_t at = bytes.find(stand_in); at != std::string::npos; at = bytes.find(stand_in, at + text.size()))
    bytes.replace(at, text.size(), text);
  return bytes;
}

std::string NameOf(grpc::StatusCode code) {
  return absl::StatusCodeToString(static_cast<absl::StatusCode>(code));
}

}  // namespace

grpc::StatusCode CallByPath(grpc::GenericStub* stub, const std::string& path, const std::string& bytes) {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kDeadline);
  grpc::CompletionQueue queue;
  const auto wait = [&queue] {
    void* tag = nullptr;
    bool ok = false;
    return queue.Next(&tag, &ok) && ok;
  };
  const auto call = stub->PrepareCall(&context, path, &queue);
  call->StartCall(nullptr);
  wait();
  const grpc::Slice slice(bytes);
  call->WriteLast(grpc::ByteBuffer(&slice, 1), {}, nullptr);
  wait();
  grpc::ByteBuffer answer;
  int answers = 0;
  for (; answers < kMaxAnswers; ++answers) {
    call->Read(&answer, nullptr);
    if (!wait()) break;
  }
  if (answers == kMaxAnswers) context.TryCancel();
  grpc::Status status;
  call->Finish(&status, nullptr);
  wait();
  return answers == kMaxAnswers ? grpc::StatusCode::OK : status.error_code();
}

bool SendHostileTexts(const std::string& server) {
  const std::shared_ptr<grpc::Channel> channel = rpc::MakeChannel(server, rpc::Security{});
  grpc::GenericStub stub(channel);
  std::map<std::string, int> codes;
  int calls = 0;
  const auto make = [&](const std::string& path, const std::string& bytes) {
    const grpc::StatusCode code = CallByPath(&stub, path, bytes);
    ++codes[NameOf(code)];
    ++calls;
    if (code == grpc::StatusCode::UNAVAILABLE || code == grpc::StatusCode::DEADLINE_EXCEEDED ||
        code == grpc::StatusCode::UNKNOWN)
      std::fprintf(stderr, "%s: %s\n", path.c_str(), NameOf(code).c_str());
  };
  for (const pb::FileDescriptor* file :
       {v1::GetJobRequest::descriptor()->file(), v1::Hello::descriptor()->file(),
        v1::LoginRequest::descriptor()->file()}) {
    for (int i = 0; i < file->service(0)->method_count(); ++i) {
      const pb::MethodDescriptor* method = file->service(0)->method(i);
      const std::string path = absl::StrCat("/", file->service(0)->full_name(), "/", method->name());
      const std::unique_ptr<pb::Message> message(
          pb::MessageFactory::generated_factory()->GetPrototype(method->input_type())->New());
      for (const std::string& text : Tricks()) {
        message->Clear();
        Fill(message.get(), text, 0);
        if (message->ByteSizeLong() < (4u << 20)) make(path, message->SerializeAsString());
      }
      for (const std::string& text : BadUtf8()) {
        const std::string stand_in(text.size(), '\x01');
        message->Clear();
        Fill(message.get(), stand_in, 0);
        make(path, WithText(message->SerializeAsString(), stand_in, text));
      }
    }
  }
  std::printf("%d calls:", calls);
  for (const auto& [code, count] : codes) std::printf(" %s=%d", code.c_str(), count);
  std::printf("\n");
  return !codes.contains("UNAVAILABLE") && !codes.contains("DEADLINE_EXCEEDED") && !codes.contains("UNKNOWN");
}

}  // namespace lumifold

#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "proto/identity/certificate.h"
#include "proto/rpc/credentials.h"

namespace lumifold::identity {

/// Name of the profile that is used where none is named.
inline constexpr char kDefaultProfile[] = "default";

/// How one user or worker of this machine gets into one coordinator, or into those of one farm: they have one
/// authority. A folder of files that only the user can read:
///
///   profile      server, kind and name, one "KEY=VALUE" a line
///   ca.pem       the authority that signs the server's certificate
///   token        of a person, or
///   person.pem   private key, certificate and authority of a person
///   worker.pem   the same of a worker
struct Profile {
  enum class Kind { kPerson, kWorker };

  std::string server;  // HOST:PORT, or those of one farm, see rpc::ParseEndpoints
  Kind kind = Kind::kPerson;
  std::string name;  // as the coordinator knows it
  /// Instead of a token. Workers always have one.
  bool has_certificate = false;
};

/// "$XDG_CONFIG_HOME/lumifold", or "$HOME/.config/lumifold"; empty where neither variable is set.
std::string ProfilesFolder();

/// The profiles of one user.
class Profiles {
 public:
  /// `folder` need not exist.
  explicit Profiles(std::string folder) : folder_(std::move(folder)) {}

  /// 1 to 64 letters, digits, "-", "_" and "."; no "." first: it becomes the name of a folder.
  /// Errors: kInvalidArgument naming it.
  static absl::Status CheckName(const std::string& profile);

  /// Errors: kNotFound naming the profile; kInvalidArgument for a malformed one, naming the file and the
  /// line; kFailedPrecondition for files that others can read. These go for all calls.
  absl::StatusOr<Profile> Read(const std::string& profile) const;
  /// Names, sorted. Those that cannot be read are among them.
  std::vector<std::string> List() const;

  /// What a channel to the profile's server needs. `name`: of the profile.
  absl::StatusOr<rpc::Security> SecurityOf(const std::string& name) const;

  /// The certificate of a profile that has one. Errors: also kInvalidArgument for a file that has none.
  absl::StatusOr<CertificateFacts> CertificateOf(const std::string& name) const;

  /// The profile to use for a command: `named` if it is not empty; otherwise the default one, if it has the
  /// `server` or none is given; otherwise the first by name that has it. nullopt where there is none and none
  /// was named. A profile has a list of servers if one of them is one of its own.
  /// Errors: kInvalidArgument where the named profile is of another server.
  absl::StatusOr<std::optional<std::string>> Choose(const std::string& named, const std::string& server,
                                                    Profile::Kind kind) const;

  /// Writes the authority's certificate to a file of its own, for the connection that fetches the secret;
  /// returns its path. An earlier profile of the name stays as it is until Write, which removes this file.
  absl::StatusOr<std::string> WritePendingCa(const std::string& name, std::string_view ca_pem) const;
  /// `secret`: the token, or the text of person.pem or worker.pem.
  absl::Status Write(const std::string& name, const Profile& profile, std::string_view ca_pem,
                     std::string_view secret) const;
  /// Replaces the key and certificate of a profile that has them.
  absl::Status WriteCertificate(const std::string& name, std::string_view pem) const;
  /// Removes its files. Errors: also kNotFound.
  absl::Status Remove(const std::string& name) const;

  std::string FolderOf(const std::string& name) const { return folder_ + "/" + name; }
  std::string CertificatePath(const std::string& name, Profile::Kind kind) const {
    return PathOf(name, kind == Profile::Kind::kWorker ? "worker.pem" : "person.pem");
  }

 private:
  std::string PathOf(const std::string& name, const char* file) const;

  std::string folder_;
};

}  // namespace lumifold::identity

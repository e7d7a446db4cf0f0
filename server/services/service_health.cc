#include "server/services/service_health.h"

#include <grpcpp/health_check_service_interface.h>

#include "lumifold/v1/access.grpc.pb.h"
#include "lumifold/v1/farm.grpc.pb.h"
#include "lumifold/v1/worker.grpc.pb.h"

namespace lumifold::server {

void ServiceHealth::Begin(grpc::HealthCheckServiceInterface* service) {
  absl::MutexLock lock(&mutex_);
  service_ = service;
  Show();
}

void ServiceHealth::SetStorage(bool is_writable) {
  absl::MutexLock lock(&mutex_);
  has_storage_ = is_writable;
  Show();
}

void ServiceHealth::Stop() {
  absl::MutexLock lock(&mutex_);
  stops_ = true;
  Show();
}

void ServiceHealth::Show() {
  if (service_ == nullptr) return;
  for (const char* name : {"", v1::AccessService::service_full_name(), v1::FarmService::service_full_name(),
                           v1::WorkerService::service_full_name()})
    service_->SetServingStatus(name, has_storage_ && !stops_);
}

}  // namespace lumifold::server

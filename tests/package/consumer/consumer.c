#include <stdio.h>
#include <tiller/tiller.h>

/* An empty configuration must be refused, with the name of the field that is wrong. */
int main(void) {
  tiller_config_t config = {0};
  const char* field = "";
  const tiller_status_t status = tiller_config_check(&config, &field);
  printf("tiller %s from C: empty configuration: %s: %s\n", tiller_version(), field, tiller_status_text(status));
  return status == tiller_status_ok || tiller_size(&config) != 0;
}

// Renders a kustomization, in the part of kustomize's language that deploy/kubernetes keeps to: resources, namespace, images,
// and, in files, JSON patches and patches that delete. Anything else is an error. `node render.mjs FOLDER` prints the manifests as a JSON array.
import fs from 'node:fs';
import path from 'node:path';
import YAML from 'yaml';

const CLUSTER_WIDE = ['Namespace', 'PriorityClass'];

function documents(file) {
  return YAML.parseAllDocuments(fs.readFileSync(file, 'utf8')).map((document) => {
    if (document.errors.length > 0) throw new Error(`${file}: ${document.errors[0].message}`);
    return document.toJS();
  });
}

function applyPatch(manifest, {op, path: pointer, value}) {
  const keys = pointer.split('/').slice(1).map((key) => key.replaceAll('~1', '/').replaceAll('~0', '~'));
  const last = keys.pop();
  const parent = keys.reduce((at, key) => at?.[key], manifest);
  if (parent === undefined) throw new Error(`patch of ${manifest.metadata.name}: no ${pointer}`);
  if (op !== 'add' && parent[last] === undefined) throw new Error(`patch of ${manifest.metadata.name}: no ${pointer}`);
  if (op === 'remove') {
    delete parent[last];
  } else if (op === 'add' && Array.isArray(parent)) {
    parent.splice(last === '-' ? parent.length : Number(last), 0, value);
  } else if (op === 'add' || op === 'replace') {
    parent[last] = value;
  } else {
    throw new Error(`patch of ${manifest.metadata.name}: '${op}' is not rendered here`);
  }
}

function containers(manifest) {
  const pod = manifest.spec?.template?.spec;
  return [...(pod?.initContainers ?? []), ...(pod?.containers ?? [])];
}

export function render(folder) {
  const [{apiVersion, kind, namespace, resources = [], images = [], patches = [], ...others}] =
    documents(path.join(folder, 'kustomization.yaml'));
  if (Object.keys(others).length > 0) throw new Error(`${folder}: not rendered here: ${Object.keys(others)}`);
  const manifests = resources.flatMap((resource) => {
    const file = path.join(folder, resource);
    return fs.statSync(file).isDirectory() ? render(file) : documents(file);
  });
  for (const {target, path: file, ...more} of patches) {
    if (Object.keys(more).length > 0) throw new Error(`${folder}: not rendered here: ${Object.keys(more)}`);
    const found = manifests.filter((m) => m.kind === target.kind && m.metadata.name === target.name);
    if (found.length !== 1) throw new Error(`${folder}: ${found.length} manifests for the patch ${file}`);
    const [patch] = documents(path.join(folder, file));
    if (patch.$patch === 'delete') {
      manifests.splice(manifests.indexOf(found[0]), 1);
    } else {
      for (const change of patch) applyPatch(found[0], change);
    }
  }
  for (const manifest of manifests) {
    if (namespace && !CLUSTER_WIDE.includes(manifest.kind)) manifest.metadata.namespace = namespace;
    for (const container of containers(manifest)) {
      const image = images.find(({name}) => name === container.image);
      if (image) container.image = `${image.newName}:${image.newTag}`;
    }
  }
  return manifests;
}

if (process.argv[1] === import.meta.filename) console.log(JSON.stringify(render(process.argv[2])));

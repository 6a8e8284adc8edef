// Put the example of a public name below its description, above its methods.
for (const object of document.querySelectorAll(".doc-object:not(.doc-object .doc-object)")) {
  const example = object.nextElementSibling;
  const children = object.querySelector(".doc-children");
  if (children && example?.classList.contains("language-pycon")) {
    children.before(example);
  }
}
